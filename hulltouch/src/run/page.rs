//! Where the page is served, how it is encrypted, and what is printed of it.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::Args;
use setup::cli::{Failure, Outcome};
use web_server::{FeedSettings, Origin};

use super::security::Security;
use super::token::{TokenFrom, token};

/// The default address of the page.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8470);

/// Who may look, and who may steer.
#[derive(Clone, Debug, Default, Args)]
pub struct PageArguments {
    /// Serve the page at this address [default: 127.0.0.1:8470, or a free port if that is taken].
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// A file with what lets a page steer the run: a line of 12 to 128 letters and digits, which others must not read
    /// [default: the variable HULLTOUCH_TOKEN, or a new one each run].
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Where a proxy with a certificate shows the page, as in https://studio.example: its name is answered too.
    #[arg(long, value_name = "ORIGIN")]
    origin: Option<String>,
    /// Open the page in this machine's browser, with the token: other users of this machine may see it in the list of
    /// processes.
    #[arg(long)]
    open: bool,
}

/// The page of a run.
#[derive(Clone, Debug)]
pub struct PagePlan {
    /// Where it is served, and for whom.
    pub feed: FeedSettings,
    /// Where its token comes from.
    pub token_from: TokenFrom,
    /// What is not encrypted though others may be on the way, in words for those who look.
    pub insecure: Option<String>,
    /// A browser is to show it.
    pub opens: bool,
}

impl PageArguments {
    /// Whether an address was asked for.
    pub fn listens(&self) -> bool {
        self.listen.is_some()
    }

    /// Whether a browser is to show it.
    pub fn opens(&self) -> bool {
        self.open
    }

    /// The page, with whatever its address needs.
    pub fn checked(&self, security: &Security) -> Outcome<PagePlan> {
        let (token, token_from) = token(self.token_file.as_deref())?;
        let (listen, or_any_port) = (self.listen.unwrap_or(LISTEN), self.listen.is_none());
        let origin = self.origin.as_deref().map(Origin::new).transpose();
        let origin = origin.map_err(|why| Failure::input(format_args!("--origin is {why}")))?;
        let is_near = listen.ip().is_loopback();
        let credentials = security.credentials.clone().filter(|_| !is_near);
        let is_open = !is_near && credentials.is_none();
        if is_open && origin.is_none() && !security.insecure {
            return Err(Failure::input(format_args!(
                "--listen {listen} is reachable from other machines and nothing is encrypted: expected {}--origin (a proxy \
                 with a certificate before it), or --insecure",
                if security.takes_certificates { "--certs, " } else { "" }
            )));
        }
        let page_in_clear = is_open && origin.is_none();
        let clear = [
            (page_in_clear, "this page is not encrypted, and anyone on the network path may read its token"),
            (security.nodes_in_clear, "cameras are asked without encryption and certificates"),
        ];
        let clear: Vec<&str> = clear.iter().filter(|(is_so, _)| *is_so).map(|(_, what)| *what).collect();
        let insecure = (!clear.is_empty()).then(|| format!("--insecure: {}", clear.join("; ")));
        Ok(PagePlan {
            feed: FeedSettings {
                listen,
                or_any_port,
                token,
                credentials,
                origin,
                begins_for_first_page: false,
            },
            token_from,
            insecure,
            opens: self.open,
        })
    }
}

impl PagePlan {
    /// Warns of what is open to others.
    pub fn warn(&self, address: SocketAddr) {
        if let Some(insecure) = &self.insecure {
            tracing::warn!("{insecure}");
        } else if !address.ip().is_loopback() && self.feed.credentials.is_none() {
            tracing::warn!(
                "the page at {address} is not encrypted: only the proxy of --origin should reach it"
            );
        }
    }

    /// Where the page is. The token is for terminals only: what is piped is kept, in journals and elsewhere.
    pub fn announcement(&self, address: SocketAddr, is_terminal: bool) -> String {
        let page = self.page(address);
        let own = self.own_origin(address);
        let origin = self.feed.origin.as_ref();
        let proxied = origin.map_or_else(String::new, |origin| format!("proxy: from {origin}/ to {own}/\n"));
        if is_terminal {
            let hint = if self.opens { "" } else { "(--open shows it in your browser)\n" };
            return format!("page: {}\nviewers: {page}\n{proxied}{hint}", self.steering_page(address));
        }
        format!("page: {page}\nviewers: {page}\n{proxied}token: {}\n", self.token_from)
    }

    /// Shows the page in this machine's browser, if that is wanted.
    pub fn open(&self, address: SocketAddr) {
        if !self.opens {
            return;
        }
        let page = self.steering_page(address);
        // What starts browsers takes a while. Its error tells the token.
        std::thread::spawn(move || {
            if open::that_detached(page).is_err() {
                tracing::warn!("--open: no browser could be started: open the page's address yourself");
            }
        });
    }

    /// Where the page is found.
    fn page(&self, address: SocketAddr) -> String {
        match &self.feed.origin {
            Some(origin) => format!("{origin}/"),
            None => format!("{}/", self.own_origin(address)),
        }
    }

    /// The same with the token.
    fn steering_page(&self, address: SocketAddr) -> String {
        format!("{}?token={}", self.page(address), self.feed.token.text())
    }

    /// This server itself. That it listens on all addresses is no address: then by this machine's name.
    fn own_origin(&self, address: SocketAddr) -> String {
        let scheme = if self.feed.credentials.is_some() { "https" } else { "http" };
        if address.ip().is_unspecified() {
            return format!("{scheme}://{}:{}", host_name(), address.port());
        }
        format!("{scheme}://{address}")
    }
}

fn host_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;
    use web_server::Token;

    fn plan(listen: &str, origin: Option<&str>, security: &Security) -> Outcome<PagePlan> {
        let listen = Some(listen.parse().expect("an address"));
        let origin = origin.map(Into::into);
        PageArguments { listen, origin, ..PageArguments::default() }.checked(security)
    }

    #[test]
    fn a_page_for_others_needs_encryption_or_consent() {
        let open = Security { insecure: true, ..Security::default() };
        let refused = plan("0.0.0.0:0", None, &Security::default()).expect_err("refused").to_string();
        assert!(refused.ends_with(
            "nothing is encrypted: expected --origin (a proxy with a certificate before it), or --insecure"
        ));
        let takes = Security { takes_certificates: true, ..Security::default() };
        let refused = plan("[::]:0", None, &takes).expect_err("refused").to_string();
        assert!(refused.contains("expected --certs, --origin"), "{refused}");
        for (listen, origin, security, is_shown) in [
            ("127.0.0.1:0", None, &Security::default(), false),
            ("127.0.0.1:0", None, &open, false),
            ("0.0.0.0:0", Some("https://studio.example"), &Security::default(), false),
            ("0.0.0.0:0", None, &open, true),
        ] {
            let plan = plan(listen, origin, security).expect("allowed");
            assert_eq!(plan.insecure.is_some(), is_shown, "{listen} {origin:?}");
        }
        let asked = Security { nodes_in_clear: true, ..open };
        let shown = plan("127.0.0.1:0", None, &asked).expect("allowed").insecure;
        assert_eq!(
            shown.as_deref(),
            Some("--insecure: cameras are asked without encryption and certificates")
        );
    }

    #[test]
    fn a_token_is_printed_to_terminals_only() {
        let plan = plan("127.0.0.1:0", None, &Security::default()).expect("allowed");
        let feed = FeedSettings { token: Token::new("let-me-steer").expect("a token"), ..plan.feed.clone() };
        let plan = PagePlan { feed, token_from: TokenFrom::File("/run/token".into()), ..plan };
        let address = "127.0.0.1:8470".parse().expect("an address");
        assert_eq!(
            plan.announcement(address, true),
            "page: http://127.0.0.1:8470/?token=let-me-steer\nviewers: http://127.0.0.1:8470/\n(--open shows it in your browser)\n"
        );
        assert_eq!(
            plan.announcement(address, false),
            "page: http://127.0.0.1:8470/\nviewers: http://127.0.0.1:8470/\ntoken: that of /run/token\n"
        );
    }

    #[test]
    fn the_page_is_announced_where_browsers_find_it() {
        let open = Security { insecure: true, ..Security::default() };
        let address = "0.0.0.0:8470".parse().expect("an address");
        let all = plan("0.0.0.0:0", None, &open).expect("allowed").announcement(address, false);
        let of_host = format!("http://{}:8470/", host_name());
        assert!(all.starts_with(&format!("page: {of_host}\nviewers: {of_host}\ntoken: ")), "{all}");
        let origin = Some("https://studio.example");
        let proxied = plan("0.0.0.0:0", origin, &open).expect("allowed").announcement(address, false);
        let expected = format!(
            "page: https://studio.example/\nviewers: https://studio.example/\n\
             proxy: from https://studio.example/ to {of_host}\ntoken: "
        );
        assert!(proxied.starts_with(&expected), "{proxied}");
    }
}
