//! Messages of multicast DNS: the query for nodes, and the announcement of one.
//!
//! An announcement is one message: PTR, SRV, TXT and addresses together. So a receiver needs no cache, in which any
//! machine of the network could leave records. A message is refused before it is parsed if it is larger than nodes send.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use simple_dns::rdata::{A, AAAA, PTR, RData, SRV, TXT};
use simple_dns::{CLASS, Label, Name, Packet, PacketFlag, QTYPE, Question, ResourceRecord, TYPE};

use super::{NODE, ROOM};

/// The largest message that is read (RFC 6762, section 17).
pub(super) const MAX_MESSAGE_BYTES: usize = 9000;
/// Questions and records of a message that is read: a query lists the announcements that are known already.
const MAX_RECORDS: usize = 256;
/// Announcements that are read of one message.
const MAX_ANNOUNCEMENTS: usize = 8;
/// Addresses that are read of an announcement, and written.
pub(super) const MAX_ADDRESSES: usize = 8;
/// A label's length, bytes.
const MAX_LABEL_BYTES: usize = 63;
const HEADER_BYTES: usize = 12;

/// How long records are valid, seconds (RFC 6762, section 10): those that name a host or an address, and others.
const HOST_TTL_S: u32 = 120;
const OTHER_TTL_S: u32 = 4500;

/// `_hulltouch._tcp.local`, and the name by which browsers list the services of a network.
const SERVICE: [&[u8]; 3] = [b"_hulltouch", b"_tcp", b"local"];
const SERVICES: [&[u8]; 4] = [b"_services", b"_dns-sd", b"_udp", b"local"];

/// What a message is, by its header alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MessageKind {
    Query,
    Response,
}

impl MessageKind {
    /// `None` for what no node and no coordinator sends.
    pub(super) fn of(datagram: &[u8]) -> Option<MessageKind> {
        if datagram.len() < HEADER_BYTES || datagram.len() > MAX_MESSAGE_BYTES {
            return None;
        }
        let number = |at: usize| usize::from(u16::from_be_bytes([datagram[at], datagram[at + 1]]));
        let records: usize = [4, 6, 8, 10].into_iter().map(number).sum();
        let (is_response, opcode) = (datagram[2] & 0x80 != 0, datagram[2] >> 3 & 0x0f);
        if records == 0 || records > MAX_RECORDS || opcode != 0 {
            return None;
        }
        Some(if is_response { MessageKind::Response } else { MessageKind::Query })
    }
}

/// What a node announces of itself.
#[derive(Clone, Debug)]
pub(super) struct Service {
    pub room: String,
    pub node: String,
    pub port: u16,
    /// Makes the names of this announcement unique, so that no other machine can claim them first.
    pub id: u32,
}

/// An announcement that was received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Announced {
    /// Of the instance's name: the same for all announcements of one node process.
    pub instance: u64,
    pub room: String,
    pub node: String,
    pub port: u16,
    pub addresses: Vec<IpAddr>,
    /// The node takes its announcement back.
    pub is_goodbye: bool,
}

fn name<'a>(labels: impl IntoIterator<Item = &'a [u8]>) -> Name<'a> {
    Name::new_with_labels(&labels.into_iter().map(Label::new_unchecked).collect::<Vec<_>>())
}

/// Asks for all nodes.
pub(super) fn query() -> Vec<u8> {
    let mut packet = Packet::new_query(0);
    packet.questions.push(Question::new(name(SERVICE), TYPE::PTR.into(), CLASS::IN.into(), false));
    packet.build_bytes_vec_compressed().unwrap_or_default()
}

impl Service {
    /// The instance's name, for people: its texts say which node it is.
    fn instance(&self) -> String {
        let id = format!(" {:08x}", self.id);
        let mut instance = format!("{}@{}", self.node, self.room);
        while instance.len() + id.len() > MAX_LABEL_BYTES {
            instance.pop();
        }
        instance + &id
    }

    fn host(&self) -> String {
        format!("hulltouch-{:08x}", self.id)
    }

    /// The announcement of a node at these addresses, or the goodbye. Empty if no message can say it.
    pub(super) fn announcement(&self, addresses: &[IpAddr], is_goodbye: bool) -> Vec<u8> {
        let ttl = |seconds: u32| if is_goodbye { 0 } else { seconds };
        let (instance, host) = (self.instance(), self.host());
        let instance = || name(std::iter::once(instance.as_bytes()).chain(SERVICE));
        let host = || name([host.as_bytes(), b"local"]);
        let shared = |owner, rdata| ResourceRecord::new(owner, CLASS::IN, ttl(OTHER_TTL_S), rdata);
        let own = |owner, seconds, rdata| {
            ResourceRecord::new(owner, CLASS::IN, ttl(seconds), rdata).with_cache_flush(true)
        };
        let texts = [(ROOM, &self.room), (NODE, &self.node)];
        let texts = texts
            .into_iter()
            .try_fold(TXT::new(), |texts, (key, value)| texts.with_attribute(key, Some(value.as_bytes())));
        let Ok(texts) = texts else { return Vec::new() };
        let srv = SRV { priority: 0, weight: 0, port: self.port, target: host() };

        let mut packet = Packet::new_reply(0);
        packet.set_flags(PacketFlag::AUTHORITATIVE_ANSWER);
        packet.answers = vec![
            shared(name(SERVICE), RData::PTR(PTR(instance()))),
            own(instance(), HOST_TTL_S, RData::SRV(srv)),
            own(instance(), OTHER_TTL_S, RData::TXT(texts)),
        ];
        if !is_goodbye {
            packet.answers.push(shared(name(SERVICES), RData::PTR(PTR(name(SERVICE)))));
        }
        packet.answers.extend(addresses.iter().take(MAX_ADDRESSES).map(|address| {
            let rdata = match address {
                IpAddr::V4(v4) => RData::A(A { address: v4.to_bits() }),
                IpAddr::V6(v6) => RData::AAAA(AAAA { address: v6.to_bits() }),
            };
            own(host(), HOST_TTL_S, rdata)
        }));
        packet.build_bytes_vec_compressed().unwrap_or_default()
    }

    /// Whether a query asks for this announcement, and does not list it as known.
    pub(super) fn is_asked_by(&self, query: &[u8]) -> bool {
        let Ok(packet) = Packet::parse(query) else { return false };
        let (instance, host) = (self.instance(), self.host());
        let instance = name(std::iter::once(instance.as_bytes()).chain(SERVICE));
        let (host, service, services) = (name([host.as_bytes(), b"local"]), name(SERVICE), name(SERVICES));
        let is_known = || {
            let known = packet.answers.iter().filter(|known| known.ttl >= OTHER_TTL_S / 2);
            known.into_iter().any(|known| {
                known.name == service && matches!(&known.rdata, RData::PTR(PTR(alias)) if *alias == instance)
            })
        };
        packet.questions.iter().any(|question| {
            let asks = |of: TYPE| question.qtype == QTYPE::ANY || question.qtype == QTYPE::TYPE(of);
            let asked = &question.qname;
            (*asked == service && asks(TYPE::PTR) && !is_known())
                || (*asked == services && asks(TYPE::PTR))
                || (*asked == instance && (asks(TYPE::SRV) || asks(TYPE::TXT)))
                || (*asked == host && (asks(TYPE::A) || asks(TYPE::AAAA)))
        })
    }
}

/// The announcements of nodes in a response, [`MAX_ANNOUNCEMENTS`] at most.
pub(super) fn announcements(response: &[u8]) -> Vec<Announced> {
    let Ok(packet) = Packet::parse(response) else { return Vec::new() };
    let records: Vec<&ResourceRecord> = packet.answers.iter().chain(&packet.additional_records).collect();
    let service = name(SERVICE);
    let instances = records.iter().filter_map(|record| match &record.rdata {
        RData::PTR(PTR(instance)) if record.name == service => Some((instance, record.ttl == 0)),
        _ => None,
    });
    instances.take(MAX_ANNOUNCEMENTS).filter_map(|(name, gone)| announced(&records, name, gone)).collect()
}

/// What a message says of an instance; `None` if that is not all that an announcement has.
fn announced(records: &[&ResourceRecord], instance: &Name, is_goodbye: bool) -> Option<Announced> {
    let of_instance = || records.iter().filter(|record| record.name == *instance);
    let srv = of_instance().find_map(|record| match &record.rdata {
        RData::SRV(srv) => Some(srv),
        _ => None,
    })?;
    let texts = of_instance().find_map(|record| match &record.rdata {
        RData::TXT(texts) => Some(texts),
        _ => None,
    })?;
    let text = |wanted: &str| {
        let is_wanted = |key: &[u8]| key.eq_ignore_ascii_case(wanted.as_bytes());
        let value = texts.iter_raw().find(|(key, _)| is_wanted(key))?.1?;
        String::from_utf8(value.to_vec()).ok()
    };
    let addresses = records.iter().filter(|record| record.name == srv.target);
    let addresses = addresses.filter_map(|record| match &record.rdata {
        RData::A(a) => Some(IpAddr::V4(Ipv4Addr::from_bits(a.address))),
        RData::AAAA(aaaa) => Some(IpAddr::V6(Ipv6Addr::from_bits(aaaa.address))),
        _ => None,
    });
    let is_somewhere = |ip: &IpAddr| !ip.is_unspecified() && !ip.is_multicast();
    let mut hasher = DefaultHasher::new();
    instance.hash(&mut hasher);
    Some(Announced {
        instance: hasher.finish(),
        room: text(ROOM)?,
        node: text(NODE)?,
        port: srv.port,
        addresses: addresses.filter(is_somewhere).take(MAX_ADDRESSES).collect(),
        is_goodbye,
    })
}

/// Panics if a message that was received breaks a bound.
pub(crate) fn check_message(datagram: &[u8]) {
    let own = Service { room: "room".into(), node: "left".into(), port: 7001, id: 7 };
    match MessageKind::of(datagram) {
        Some(MessageKind::Query) => drop(own.is_asked_by(datagram)),
        Some(MessageKind::Response) => {
            let found = announcements(datagram);
            assert!(found.len() <= MAX_ANNOUNCEMENTS);
            assert!(found.iter().all(|announced| announced.addresses.len() <= MAX_ADDRESSES));
            assert!(found.iter().all(|announced| announced.node.len() + announced.room.len() <= 512));
        }
        None => {}
    }
}

/// A query, an announcement, a goodbye, and an announcement of IPv6 addresses.
#[cfg(test)]
pub(crate) fn example_messages() -> Vec<Vec<u8>> {
    let own = Service { room: "room".into(), node: "left".into(), port: 7001, id: 7 };
    let (v4, v6) = (IpAddr::V4(Ipv4Addr::LOCALHOST), IpAddr::V6(Ipv6Addr::LOCALHOST));
    vec![
        query(),
        own.announcement(&[v4], false),
        own.announcement(&[v4], true),
        own.announcement(&[v6; 8], false),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left() -> Service {
        Service { room: "studio".into(), node: "left".into(), port: 7001, id: 0xc0ffee }
    }

    const AT: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 7));

    #[test]
    fn an_announcement_is_one_message_that_says_all() {
        let message = left().announcement(&[AT], false);
        assert_eq!(MessageKind::of(&message), Some(MessageKind::Response));
        let found = announcements(&message);
        let [announced] = &found[..] else { panic!("found {found:?}") };
        assert_eq!((&announced.room[..], &announced.node[..], announced.port), ("studio", "left", 7001));
        assert_eq!((&announced.addresses[..], announced.is_goodbye), (&[AT][..], false));
        let goodbye = announcements(&left().announcement(&[], true));
        assert!(goodbye.iter().all(|gone| gone.is_goodbye && gone.instance == announced.instance));
        assert_eq!(goodbye.len(), 1);
    }

    #[test]
    fn names_that_are_too_long_for_a_label_are_cut() {
        let service = Service { node: "é".repeat(40), ..left() };
        let found = announcements(&service.announcement(&[AT], false));
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].node, "é".repeat(40));
    }

    #[test]
    fn a_query_that_knows_the_announcement_does_not_ask_for_it() {
        assert_eq!(MessageKind::of(&query()), Some(MessageKind::Query));
        assert!(left().is_asked_by(&query()));
        let (query, announcement) = (query(), left().announcement(&[AT], false));
        let mut knows = Packet::parse(&query).expect("valid");
        knows.answers.push(Packet::parse(&announcement).expect("valid").answers[0].clone());
        let known = knows.build_bytes_vec_compressed().expect("written");
        assert!(!left().is_asked_by(&known));
        assert!(Service { id: 1, ..left() }.is_asked_by(&known), "that is another's");
    }

    #[test]
    fn browsers_may_ask_for_each_name_alone() {
        let service = left();
        let instance = service.instance();
        let asks = |labels: &[&[u8]], of: TYPE| {
            let mut packet = Packet::new_query(7);
            let asked = name(labels.iter().copied());
            packet.questions.push(Question::new(asked, of.into(), CLASS::IN.into(), true));
            service.is_asked_by(&packet.build_bytes_vec_compressed().expect("written"))
        };
        let [of, protocol, local] = SERVICE;
        assert!(asks(&[instance.as_bytes(), of, protocol, local], TYPE::SRV));
        assert!(asks(&[b"_HullTouch", protocol, local], TYPE::PTR), "names have no case");
        assert!(asks(&SERVICES, TYPE::PTR));
        assert!(asks(&[service.host().as_bytes(), local], TYPE::A));
        assert!(!asks(&[b"_http", protocol, local], TYPE::PTR));
        assert!(!asks(&[b"other", local], TYPE::A));
    }

    #[test]
    fn a_header_that_promises_more_than_nodes_send_is_refused_unparsed() {
        let mut message = query();
        message[4..6].copy_from_slice(&1000_u16.to_be_bytes());
        assert_eq!(MessageKind::of(&message), None);
        assert_eq!(MessageKind::of(&[0; HEADER_BYTES]), None);
        assert_eq!(MessageKind::of(&[0; 3]), None);
        assert_eq!(MessageKind::of(&[1; MAX_MESSAGE_BYTES + 1]), None);
    }

    #[test]
    fn bytes_that_are_no_message_are_no_announcement_and_no_query() {
        let whole = left().announcement(&[AT], false);
        for end in 0..whole.len() {
            assert_eq!(announcements(&whole[..end]), [], "{end} bytes");
        }
        for at in 0..whole.len() {
            for bits in [0x01, 0x80, 0xc0, 0xff] {
                let mut changed = whole.clone();
                changed[at] ^= bits;
                // Neither panics nor waits.
                announcements(&changed);
                left().is_asked_by(&changed);
            }
        }
    }
}
