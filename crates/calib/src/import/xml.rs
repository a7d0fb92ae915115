//! A small XML file as a tree: what calibration files need of XML.

use hull::text::{MAX_QUOTED_CHARS, shortened};
use quick_xml::Reader;
use quick_xml::encoding::EncodingError;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::attributes::AttrError;
use quick_xml::events::{BytesRef, BytesStart, Event};
use thiserror::Error;

use super::{ImportError, TextFile};

/// Calibration files nest four deep; a bound keeps hostile ones off the stack.
const MAX_DEPTH: usize = 32;
/// Cameras have a dozen; each is compared with those before it.
const MAX_ATTRIBUTES: usize = 100;

/// Why a text is no such tree.
#[derive(Debug, Error)]
enum XmlError {
    #[error(transparent)]
    Malformed(#[from] quick_xml::Error),
    #[error(transparent)]
    Attribute(#[from] AttrError),
    #[error(transparent)]
    Encoding(#[from] EncodingError),
    #[error("elements nested more than {MAX_DEPTH} deep")]
    Depth,
    #[error("an element with more than {MAX_ATTRIBUTES} attributes")]
    Attributes,
    #[error("the end inside an element")]
    Cut,
    #[error("no element")]
    Empty,
    #[error("a second document behind the first")]
    Roots,
    #[error("the entity &{0};")]
    Entity(String),
}

/// An element with its attributes, text and child elements.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) attributes: Vec<(String, String)>,
    pub(super) text: String,
    pub(super) children: Vec<Element>,
}

impl Element {
    pub(super) fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.name == name)
    }

    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }
}

/// The document's root element.
pub(super) fn parse(file: &TextFile) -> Result<Element, ImportError> {
    let mut reader = Reader::from_str(&file.text);
    root(&mut reader).map_err(|error| {
        let at = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX);
        let before = file.text.get(..at).unwrap_or(&file.text);
        let line = before.matches('\n').count() + 1;
        ImportError::syntax(file, line, &error.to_string(), "well-formed XML")
    })
}

fn root(reader: &mut Reader<&[u8]>) -> Result<Element, XmlError> {
    let mut open = vec![Element::default()];
    loop {
        match reader.read_event()? {
            Event::Start(tag) => {
                if open.len() > MAX_DEPTH {
                    return Err(XmlError::Depth);
                }
                open.push(element(&tag)?);
            }
            Event::Empty(tag) => {
                let child = element(&tag)?;
                if let Some(parent) = open.last_mut() {
                    parent.children.push(child);
                }
            }
            Event::End(_) => {
                if let (Some(child), Some(parent)) = (open.pop(), open.last_mut()) {
                    parent.children.push(child);
                }
            }
            Event::Text(text) => {
                let text = text.decode()?;
                if let Some(parent) = open.last_mut() {
                    parent.text.push_str(&text);
                }
            }
            Event::CData(text) => {
                let text = text.decode()?;
                if let Some(parent) = open.last_mut() {
                    parent.text.push_str(&text);
                }
            }
            Event::GeneralRef(entity) => {
                let text = resolved(&entity)?;
                if let Some(parent) = open.last_mut() {
                    parent.text.push_str(&text);
                }
            }
            Event::Eof if open.len() > 1 => return Err(XmlError::Cut),
            Event::Eof => {
                let mut roots = open.pop().map(|document| document.children).unwrap_or_default();
                return match (roots.pop(), roots.pop()) {
                    (Some(root), None) => Ok(root),
                    (None, _) => Err(XmlError::Empty),
                    (Some(_), Some(_)) => Err(XmlError::Roots),
                };
            }
            _ => {}
        }
    }
}

/// The text that an entity stands for: `&#45;`, `&lt;`.
fn resolved(entity: &BytesRef) -> Result<String, XmlError> {
    if let Some(character) = entity.resolve_char_ref()? {
        return Ok(character.to_string());
    }
    let name = entity.decode()?;
    let text = resolve_predefined_entity(&name).map(str::to_owned);
    text.ok_or_else(|| XmlError::Entity(shortened(&name, MAX_QUOTED_CHARS)))
}

fn element(tag: &BytesStart) -> Result<Element, XmlError> {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let mut element = Element { name: text(tag.name().as_ref()), ..Element::default() };
    for attribute in tag.attributes() {
        let attribute = attribute?;
        if element.attributes.len() == MAX_ATTRIBUTES {
            return Err(XmlError::Attributes);
        }
        let value = attribute.unescape_value()?;
        element.attributes.push((text(attribute.key.as_ref()), value.into_owned()));
    }
    Ok(element)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Element, ImportError> {
        parse(&TextFile { path: "f.xml".to_owned(), text: text.to_owned() })
    }

    #[test]
    fn elements_attributes_and_text_are_found() {
        let root =
            read("<?xml version=\"1.0\"?>\n<a><b k=\"1 &lt; 2\"/><c>\n 3 4</c></a>").expect("well-formed");
        assert_eq!(root.child("b").and_then(|b| b.attribute("k")), Some("1 < 2"));
        assert_eq!(root.child("c").map(|c| c.text.trim()), Some("3 4"));
    }

    #[test]
    fn broken_files_are_refused_with_the_line() {
        let cut = read("<a>\n<b>1</b>\n").expect_err("cut off").to_string();
        assert!(cut.starts_with("f.xml: line 3: found the end inside an element"), "{cut}");
        assert!(read("<a>\n</b>").expect_err("wrong end").to_string().starts_with("f.xml: line 2: "));
        assert!(read("").is_err());
        assert!(read(&"<a>".repeat(1000)).expect_err("too deep").to_string().contains("nested"));
        let many: String = (0..200_000).map(|number| format!(" a{number}=\"1\"")).collect();
        let wide = read(&format!("<a{many}/>")).expect_err("too many attributes").to_string();
        assert!(wide.contains("more than 100 attributes"), "{wide}");
    }
}
