//! The token of the page: from a file, from the environment, or by chance.

use std::env::{self, VarError};
use std::fmt;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use setup::cli::{Failure, Outcome};
use web_server::Token;

/// The variable that may hold the token.
pub const VARIABLE: &str = "HULLTOUCH_TOKEN";
/// Far more than a token and the end of its line.
const MAX_FILE_BYTES: u64 = 1024;
/// Permissions of all who are neither the file's owner nor of its group.
const OTHERS: u32 = 0o007;

/// Where a token comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TokenFrom {
    /// A file.
    File(PathBuf),
    /// The environment.
    Environment,
    /// Chance: another one each run.
    Chance,
}

impl fmt::Display for TokenFrom {
    /// For those who see no token, where they find it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TokenFrom::File(path) => write!(f, "that of {}", path.display()),
            TokenFrom::Environment => write!(f, "that of {VARIABLE}"),
            TokenFrom::Chance => {
                write!(
                    f,
                    "a random one, printed to terminals only; choose one with --token-file FILE or {VARIABLE}"
                )
            }
        }
    }
}

/// The token of a run. A file that was named goes before the environment.
pub fn token(file: Option<&Path>) -> Outcome<(Token, TokenFrom)> {
    if let Some(path) = file {
        return Ok((read(path)?, TokenFrom::File(path.to_owned())));
    }
    match env::var(VARIABLE) {
        Ok(text) => Ok((parse(VARIABLE, &text)?, TokenFrom::Environment)),
        Err(VarError::NotPresent) => Ok((Token::random().map_err(Failure::run)?, TokenFrom::Chance)),
        Err(VarError::NotUnicode(_)) => {
            Err(Failure::input(format_args!("{VARIABLE} is no text, expected a token")))
        }
    }
}

fn read(path: &Path) -> Outcome<Token> {
    let shown = path.display();
    let wrong = |why: &dyn fmt::Display| Failure::input(format_args!("--token-file {shown}: {why}"));
    let file = File::open(path).map_err(|error| wrong(&error))?;
    let mode = file.metadata().map_err(|error| wrong(&error))?.permissions().mode() & 0o777;
    if mode & OTHERS != 0 {
        return Err(wrong(&format_args!(
            "it has mode {mode:04o}: others may read it, expected 0600 or 0640"
        )));
    }
    let mut text = String::new();
    file.take(MAX_FILE_BYTES).read_to_string(&mut text).map_err(|error| wrong(&error))?;
    let line = text.strip_suffix('\n').unwrap_or(&text);
    parse(&format!("--token-file {shown}"), line.strip_suffix('\r').unwrap_or(line))
}

/// What is wrong is said without the text: it is a secret.
fn parse(from: &str, text: &str) -> Outcome<Token> {
    Token::new(text).map_err(|why| Failure::input(format_args!("{from} is {why}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn read_of(text: &[u8], mode: u32) -> Result<String, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        fs::write(&path, text).expect("written");
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("set");
        let read = token(Some(&path)).map(|(token, _)| token.text().to_owned());
        read.map_err(|failure| failure.to_string().replace(&path.display().to_string(), "FILE"))
    }

    #[test]
    fn a_token_is_one_line_of_a_file_that_others_cannot_read() {
        for text in ["let-me-steer", "let-me-steer\n", "let-me-steer\r\n"] {
            for mode in [0o400, 0o600, 0o640] {
                assert_eq!(read_of(text.as_bytes(), mode), Ok("let-me-steer".to_owned()));
            }
        }
        let found = |bytes: usize| {
            format!(
                "--token-file FILE is a token of {bytes} bytes, expected 12 to 128 letters, digits or any of -_.~"
            )
        };
        assert_eq!(read_of(b"", 0o600), Err(found(0)));
        assert_eq!(read_of(b"\n", 0o600), Err(found(0)));
        assert_eq!(read_of(b"12345678901", 0o600), Err(found(11)));
        assert_eq!(read_of(&[b'a'; 129], 0o600), Err(found(129)));
        assert_eq!(read_of(b"let-me-steer\nor-me-too", 0o600), Err(found(22)), "two lines");
        assert_eq!(read_of(&[b'a'; 9000], 0o600), Err(found(1024)), "no more is read");
        let open = "--token-file FILE: it has mode 0644: others may read it, expected 0600 or 0640";
        assert_eq!(read_of(b"let-me-steer", 0o644), Err(open.to_owned()));
        assert!(read_of(&[0xff; 9], 0o600).is_err_and(|why| why.contains("valid UTF-8")));
        let missing = token(Some(Path::new("/nowhere/token"))).expect_err("refused").to_string();
        assert_eq!(missing, "--token-file /nowhere/token: No such file or directory (os error 2)");
        let folder = token(Some(Path::new("/"))).expect_err("refused").to_string();
        assert!(folder.starts_with("--token-file /: "), "{folder}");
    }
}
