//! Who may look and who may steer.
//!
//! Every client that reaches the port may look; a client with the token may steer. A page of another site, in a
//! browser on this machine, reaches loopback ports too, and by a name that its owner points here (DNS
//! rebinding) even as its own: so on a loopback port only loopback names are answered, and WebSockets only
//! for pages of this very server.

use std::fmt;
use std::net::SocketAddr;

use axum::http::{HeaderMap, StatusCode, Uri, header};
use proto::text::clean;
use thiserror::Error;

/// The secret that lets its holder steer.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// The shortest token, bytes: guessing one of letters takes years.
const MIN_TOKEN_BYTES: usize = 12;
/// The longest token, bytes: it is part of an address.
const MAX_TOKEN_BYTES: usize = 128;
/// The most characters of a header that an answer repeats.
const MAX_SHOWN_CHARS: usize = 100;

impl Token {
    /// A chosen token: 12 to 128 letters, digits, `-`, `_`, `.` or `~`, which stand in an address
    /// as they are.
    pub fn new(text: &str) -> Result<Token, TokenError> {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte);
        if !(MIN_TOKEN_BYTES..=MAX_TOKEN_BYTES).contains(&text.len()) || !text.bytes().all(is_plain) {
            return Err(TokenError { found_bytes: text.len() });
        }
        Ok(Token(text.into()))
    }

    /// A random token of 128 bits.
    pub fn random() -> Result<Token, RandomError> {
        random_hex().map(Token)
    }

    /// As it stands in an address.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether a text is this token; takes the same time whatever it is.
    pub fn is(&self, text: &str) -> bool {
        // Hashes compare in constant time, and of the same length.
        blake3::hash(self.0.as_bytes()) == blake3::hash(text.as_bytes())
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Token(hidden)")
    }
}

/// A text that is no token.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "a token of {found_bytes} bytes, expected {MIN_TOKEN_BYTES} to {MAX_TOKEN_BYTES} letters, digits or any of -_.~"
)]
pub struct TokenError {
    found_bytes: usize,
}

/// A text that is no origin.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{found:?}, expected https://HOST or https://HOST:PORT")]
pub struct OriginError {
    found: String,
}

/// Why the system gave no random bytes.
#[derive(Debug, Error)]
#[error("the system gives no random bytes: {0}")]
pub struct RandomError(getrandom::Error);

/// Where pages come from: `https://host` or `https://host:port`, or with `http`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    authority: String,
    text: String,
}

impl Origin {
    /// An origin as browsers send it.
    pub fn new(text: &str) -> Result<Origin, OriginError> {
        let authority = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-.:[]".contains(&byte);
        match authority {
            Some(authority) if !authority.is_empty() && authority.bytes().all(is_plain) => {
                Ok(Origin { authority: authority.into(), text: text.into() })
            }
            _ => Err(OriginError { found: text.into() }),
        }
    }

    fn is_host(&self, asked: &str) -> bool {
        self.authority.eq_ignore_ascii_case(asked)
    }
}

impl fmt::Display for Origin {
    /// As it was given.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// 128 bits from the system, as hexadecimal digits.
pub(crate) fn random_hex() -> Result<String, RandomError> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes).map_err(RandomError)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Decides which requests are answered, and who may steer.
#[derive(Clone, Debug)]
pub(crate) struct Access {
    token: Token,
    is_loopback: bool,
    /// Where a proxy shows this server.
    origin: Option<Origin>,
}

/// Why a request is not answered.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum Denied {
    #[error("no Host, expected one")]
    NoHost,
    #[error("Host is {0:?}, expected localhost or a loopback address")]
    Host(String),
    #[error("Origin is {0:?}, expected a page of this server")]
    Origin(String),
}

impl Denied {
    pub fn status(&self) -> StatusCode {
        if *self == Denied::NoHost { StatusCode::BAD_REQUEST } else { StatusCode::FORBIDDEN }
    }
}

impl Access {
    pub fn new(token: Token, address: SocketAddr, origin: Option<Origin>) -> Access {
        Access { token, is_loopback: address.ip().is_loopback(), origin }
    }

    /// Whether this text is the token.
    pub fn may_steer(&self, token: Option<&str>) -> bool {
        token.is_some_and(|token| self.token.is(token))
    }

    /// Refuses requests that a browser makes for a page of another site.
    pub fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), Denied> {
        let text =
            |name| headers.get(name).map(|value| String::from_utf8_lossy(value.as_bytes()).into_owned());
        // HTTP/2 has it in the address.
        let asked = uri.authority().map(ToString::to_string).or_else(|| text(header::HOST));
        let asked = asked.ok_or(Denied::NoHost)?;
        let is_shown = self.origin.as_ref().is_some_and(|origin| origin.is_host(&asked));
        if self.is_loopback && !is_shown && !is_loopback_name(host_of(&asked)) {
            return Err(Denied::Host(clean(&asked, MAX_SHOWN_CHARS)));
        }
        let Some(origin) = text(header::ORIGIN) else { return Ok(()) };
        let from = origin.split_once("://").map_or("", |(_, rest)| rest);
        let is_shown = self.origin.as_ref().is_some_and(|shown| shown.text.eq_ignore_ascii_case(&origin));
        let is_own = is_shown || from.eq_ignore_ascii_case(&asked);
        // A page under development comes from another port of this machine.
        let is_near = self.is_loopback && is_loopback_name(host_of(from));
        if is_own || is_near {
            return Ok(());
        }
        Err(Denied::Origin(clean(&origin, MAX_SHOWN_CHARS)))
    }
}

/// The token of `Bearer TOKEN`: HTTP compares the scheme's name without case, and allows several spaces (RFC 9110,
/// section 11).
pub(crate) fn bearer_token(authorization: &str) -> Option<&str> {
    let (scheme, token) = authorization.trim_matches([' ', '\t']).split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim_start_matches(' '))
}

/// `host` of `host`, `host:port`, `[v6]` and `[v6]:port`.
fn host_of(authority: &str) -> &str {
    if let Some(rest) = authority.strip_prefix('[') {
        return rest.split(']').next().unwrap_or_default();
    }
    authority.rsplit_once(':').map_or(authority, |(host, _)| host)
}

fn is_loopback_name(host: &str) -> bool {
    host.eq_ignore_ascii_case("localhost")
        || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(listen: &str, host: &str, origin: Option<&str>) -> bool {
        check_behind(None, listen, host, origin)
    }

    fn check_behind(proxy: Option<&str>, listen: &str, host: &str, origin: Option<&str>) -> bool {
        let token = Token::new("123456789012").expect("a token");
        let proxy = proxy.map(|proxy| Origin::new(proxy).expect("an origin"));
        let access = Access::new(token, listen.parse().expect("an address"), proxy);
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().expect("a value"));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, origin.parse().expect("a value"));
        }
        access.check(&Uri::from_static("/feed"), &headers).is_ok()
    }

    #[test]
    fn a_loopback_port_answers_loopback_names_only() {
        for host in ["localhost:8470", "127.0.0.1:8470", "LOCALHOST", "[::1]:8470", "127.0.0.2"] {
            assert!(check("127.0.0.1:8470", host, None), "{host}");
        }
        for host in ["evil.example:8470", "localhost.evil.example", "192.0.2.1:8470", "", "[::2]:1"] {
            assert!(!check("127.0.0.1:8470", host, None), "{host}");
        }
        assert!(check("0.0.0.0:8470", "studio.example:8470", None), "an open port has any name");
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let local = |origin| check("127.0.0.1:8470", "127.0.0.1:8470", Some(origin));
        assert!(local("http://127.0.0.1:8470") && local("http://localhost:5173"));
        assert!(!local("https://evil.example") && !local("null"));
        let open = |origin| check("0.0.0.0:8470", "studio.example:8470", Some(origin));
        assert!(open("http://studio.example:8470"));
        assert!(!open("http://evil.example:8470") && !open("http://localhost:8470"));
    }

    #[test]
    fn a_configured_proxy_may_ask_in_its_own_name() {
        let behind =
            |host, origin| check_behind(Some("https://studio.example"), "127.0.0.1:8470", host, Some(origin));
        // Some proxies keep the Host, some put their own there.
        assert!(behind("studio.example", "https://studio.example"));
        assert!(behind("127.0.0.1:8470", "https://studio.example"));
        assert!(!behind("studio.example", "https://evil.example"));
        assert!(!behind("127.0.0.1:8470", "http://studio.example"), "another scheme is another origin");
        assert!(!behind("evil.example", "https://studio.example"));
        for wrong in ["studio.example", "https://", "https://studio.example/", "ftp://studio.example"] {
            assert!(Origin::new(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_bearer_token_is_read_in_any_case_of_the_scheme() {
        let token = Token::new("abcd-1234-56").expect("a token");
        let access = Access::new(token, SocketAddr::from(([127, 0, 0, 1], 1)), None);
        for right in
            ["Bearer abcd-1234-56", "bearer abcd-1234-56", "BEARER   abcd-1234-56", " bEaReR abcd-1234-56 "]
        {
            assert!(access.may_steer(bearer_token(right)), "{right:?}");
        }
        for wrong in [
            "abcd-1234-56",
            "Bearerabcd-1234-56",
            "Bearer",
            "Bearer ",
            "Basic abcd-1234-56",
            "Bearer ABCD-1234",
            "Bearer Bearer abcd-1234-56",
            "Bearer abcd-1234-56 x",
            "Bearer abcd-1234-56, Bearer abcd-1234-56",
            "",
        ] {
            assert!(!access.may_steer(bearer_token(wrong)), "{wrong:?}");
        }
    }

    #[test]
    fn the_token_alone_lets_steer() {
        let token = Token::new("abcd-1234-56").expect("a token");
        let access = Access::new(token.clone(), SocketAddr::from(([127, 0, 0, 1], 1)), None);
        assert!(access.may_steer(Some("abcd-1234-56")));
        assert!(
            !access.may_steer(Some("abcd-1235-56")) && !access.may_steer(Some("")) && !access.may_steer(None)
        );
        assert_eq!(format!("{token:?}"), "Token(hidden)");
        assert!(Token::new("eleven-long").is_err() && Token::new("with space").is_err());
        let random = Token::random().expect("chance");
        assert_eq!(random.text().len(), 32);
        assert_ne!(random, Token::random().expect("chance"));
    }
}
