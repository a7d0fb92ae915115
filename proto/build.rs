//! Compiles the protocol and the messages of a recording without `protoc`.

#![allow(clippy::disallowed_macros, reason = "Cargo reads what is printed")]

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files = [
        "proto/hulltouch/v1/node.proto",
        "proto/hulltouch/v1/status.proto",
        "proto/hulltouch/v1/world.proto",
    ];
    println!("cargo:rerun-if-changed=proto");
    let descriptors = protox::compile(files, ["proto"])?;
    let out = std::path::PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("hulltouch_v1.bin"), prost::Message::encode_to_vec(&descriptors))?;
    tonic_prost_build::configure()
        .bytes(".")
        .codec_path("crate::codec::BoundedCodec")
        .compile_fds(descriptors)?;
    let descriptors = protox::compile(["proto/hulltouch/recording/v1/recording.proto"], ["proto"])?;
    std::fs::write(out.join("recording_v1.bin"), prost::Message::encode_to_vec(&descriptors))?;
    prost_build::Config::new().compile_fds(descriptors)?;
    Ok(())
}
