//! Names by which browsers call the machine of the page.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

use thiserror::Error;

use crate::name::Identity;

/// The longest name that DNS carries, in characters.
const MAX_NAME_CHARS: usize = 253;
/// The longest part between two points.
const MAX_LABEL_CHARS: usize = 63;

/// A DNS name or an IP address, written as certificates and browsers write it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageName(String);

/// Why a text is no such name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PageNameError {
    /// An address as browsers show it.
    #[error("found an address with a scheme or a path, expected the name in it alone")]
    Url,
    /// A name and a port: certificates are of names.
    #[error("found a name with a port, expected the name alone")]
    Port,
    /// Letters that DNS has not.
    #[error("found characters that are not ASCII, expected the name's ASCII form, which begins with xn--")]
    NotAscii,
    /// An address that only one machine understands.
    #[error("found an IPv6 address with a zone, expected one without")]
    Zone,
    /// Four numbers of which one is too large, or fewer.
    #[error("found a last part of digits, expected a DNS name or a whole IP address")]
    Digits,
    /// An address of no machine, or of many.
    #[error("found an address of no single machine, expected that of the page's")]
    NoMachine,
    /// A star that browsers do not take.
    #[error("found a star, expected one only as the first part, before two others: *.studio.example")]
    Star,
    /// What stands between points.
    #[error(
        "found a part that is empty, longer than {MAX_LABEL_CHARS} or not of letters, digits, - and _, expected a DNS name \
         or an IP address"
    )]
    Label,
    /// Too long as a whole.
    #[error("found more than {MAX_NAME_CHARS} characters, expected at most as many")]
    Long,
    /// A name by which machines of a room know each other.
    #[error("found a name of a machine of a room, expected one that browsers use")]
    OfRoom,
}

impl FromStr for PageName {
    type Err = PageNameError;

    fn from_str(text: &str) -> Result<PageName, PageNameError> {
        if !text.is_ascii() {
            return Err(PageNameError::NotAscii);
        }
        if text.contains('/') {
            return Err(PageNameError::Url);
        }
        if let Some((inside, after)) = text.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            return match inside.parse::<Ipv6Addr>() {
                Ok(address) if after.is_empty() => of_address(address.into()),
                Ok(_) => Err(PageNameError::Port),
                Err(_) if inside.contains('%') => Err(PageNameError::Zone),
                Err(_) => Err(PageNameError::Label),
            };
        }
        if let Ok(address) = text.parse::<IpAddr>() {
            return of_address(address);
        }
        match text.split_once(':') {
            Some((_, port)) if !port.contains(':') => Err(PageNameError::Port),
            Some(_) if text.contains('%') => Err(PageNameError::Zone),
            _ => dns_name(text),
        }
    }
}

/// The name of an address that one machine can have.
fn of_address(address: IpAddr) -> Result<PageName, PageNameError> {
    if address.is_unspecified() || address.is_multicast() || address == Ipv4Addr::BROADCAST {
        return Err(PageNameError::NoMachine);
    }
    Ok(PageName(address.to_string()))
}

/// A DNS name in lower case, without the point at its end.
fn dns_name(text: &str) -> Result<PageName, PageNameError> {
    let name = text.strip_suffix('.').unwrap_or(text).to_ascii_lowercase();
    if name.len() > MAX_NAME_CHARS {
        return Err(PageNameError::Long);
    }
    let below_star = name.strip_prefix("*.");
    if name.contains('*') && !below_star.is_some_and(|rest| rest.contains('.') && !rest.contains('*')) {
        return Err(PageNameError::Star);
    }
    let labels: Vec<&str> = below_star.unwrap_or(&name).split('.').collect();
    if !labels.iter().all(|label| is_label(label)) {
        return Err(PageNameError::Label);
    }
    // Browsers read such a name as an IPv4 address, hexadecimal numbers too.
    let is_number = |label: &str| {
        label.bytes().all(|c| c.is_ascii_digit())
            || label.strip_prefix("0x").is_some_and(|digits| digits.bytes().all(|c| c.is_ascii_hexdigit()))
    };
    if labels.last().is_some_and(|last| is_number(last)) {
        return Err(PageNameError::Digits);
    }
    let of_room = |name: &str| Identity::from_dns_name(name).is_some();
    // A star stands for any one part, a node's name among them.
    if of_room(&name) || below_star.is_some_and(|rest| of_room(&format!("any.{rest}"))) {
        return Err(PageNameError::OfRoom);
    }
    Ok(PageName(name))
}

fn is_label(label: &str) -> bool {
    let is_plain = |c: u8| c.is_ascii_alphanumeric() || c == b'-' || c == b'_';
    (1..=MAX_LABEL_CHARS).contains(&label.len())
        && label.bytes().all(is_plain)
        && !label.starts_with('-')
        && !label.ends_with('-')
}

impl fmt::Display for PageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_addresses_are_written_in_one_way() {
        for (text, name) in [
            ("localhost", "localhost"),
            ("coordinator-pc.local", "coordinator-pc.local"),
            ("Studio.Example.", "studio.example"),
            ("xn--bhne-5qa.example", "xn--bhne-5qa.example"),
            ("my_pc", "my_pc"),
            ("*.studio.example", "*.studio.example"),
            ("192.0.2.7", "192.0.2.7"),
            ("fd00:0::7", "fd00::7"),
            ("[::1]", "::1"),
            ("7.example", "7.example"),
        ] {
            let read = text.parse::<PageName>().map(|name| name.to_string());
            assert_eq!(read.as_deref(), Ok(name), "{text}");
        }
    }

    #[test]
    fn what_no_browser_would_take_is_refused_with_the_reason() {
        let long = format!("{}.example", "a".repeat(64));
        let longer = format!("{}example", "abcdefg.".repeat(32));
        for (text, why) in [
            ("https://studio.example", PageNameError::Url),
            ("studio.example/page", PageNameError::Url),
            ("studio.example:8470", PageNameError::Port),
            ("192.0.2.7:8470", PageNameError::Port),
            ("[::1]:8470", PageNameError::Port),
            ("192.0.2.0/24", PageNameError::Url),
            ("bühne.example", PageNameError::NotAscii),
            ("fe80::1%eth0", PageNameError::Zone),
            ("[fe80::1%eth0]", PageNameError::Zone),
            ("10.0.0.256", PageNameError::Digits),
            ("10.0.0", PageNameError::Digits),
            ("8470", PageNameError::Digits),
            ("0x7f000001", PageNameError::Digits),
            ("a.0x1", PageNameError::Digits),
            ("0.0.0.0", PageNameError::NoMachine),
            ("[::]", PageNameError::NoMachine),
            ("224.0.0.1", PageNameError::NoMachine),
            ("255.255.255.255", PageNameError::NoMachine),
            ("*", PageNameError::Star),
            ("*.example", PageNameError::Star),
            ("cam*.studio.example", PageNameError::Star),
            ("*.*.studio.example", PageNameError::Star),
            ("", PageNameError::Label),
            (".", PageNameError::Label),
            ("studio..example", PageNameError::Label),
            (".studio.example", PageNameError::Label),
            ("studio.example..", PageNameError::Label),
            ("my studio", PageNameError::Label),
            (" studio.example", PageNameError::Label),
            ("studio.example\n", PageNameError::Label),
            ("-studio.example", PageNameError::Label),
            ("studio-.example", PageNameError::Label),
            ("a,b", PageNameError::Label),
            ("you@studio.example", PageNameError::Label),
            ("1:2:3", PageNameError::Label),
            ("[::1", PageNameError::Label),
            (&long, PageNameError::Label),
            (&longer, PageNameError::Long),
            ("left.node.room.hulltouch", PageNameError::OfRoom),
            ("Coordinator.room.hulltouch", PageNameError::OfRoom),
            ("*.node.room.hulltouch", PageNameError::OfRoom),
        ] {
            assert_eq!(text.parse::<PageName>(), Err(why), "{text:?}");
        }
    }
}
