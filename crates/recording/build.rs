//! Compiles the recording's messages without `protoc`.

#![allow(clippy::disallowed_macros, reason = "Cargo reads what is printed")]

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = "proto";
    let file = "hulltouch/recording/v1/recording.proto";
    println!("cargo:rerun-if-changed={folder}/{file}");
    let descriptors = protox::compile([file], [folder])?;
    let out = std::path::PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("recording_v1.bin"), prost::Message::encode_to_vec(&descriptors))?;
    prost_build::Config::new().compile_fds(descriptors)?;
    Ok(())
}
