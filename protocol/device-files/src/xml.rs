//! Element tree of an XML file, with lines, in bounded memory.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::HashMap;
use std::fmt::Display;

use quick_xml::escape::unescape;
use quick_xml::events::Event;
use quick_xml::events::attributes::Attributes;
use quick_xml::reader::Reader;

use crate::fault::{FileFault, excerpt};

/// Limits of a tree. With them, the text and what readers keep of it, memory stays below 100 MiB
/// (`tests/bounds.rs`). A file of 4 MB, such as those of terminals with analogue inputs, has about 103,000 elements.
const MOST_ELEMENTS: usize = 600_000;
const MOST_ATTRIBUTES: usize = 600_000;
/// Tags, texts and references to characters, which bound the time: four for each element.
const MOST_PIECES: usize = 2_400_000;
const MOST_NAMES: usize = 4_096;
const MOST_DEPTH: usize = 64;
/// Bytes that a reader may keep of one file. References let a short file describe a large device.
const MOST_KEPT: usize = 24 << 20;

/// Element in the order of the file; its descendants follow it up to `end`.
struct XmlNode {
    name: u16,
    attributes: u16,
    first_attribute: u32,
    line: u32,
    end: u32,
    text: Option<u32>,
}

/// Tree of an XML file. Names are without the prefix of their namespace.
pub(crate) struct Document<'a> {
    names: Vec<&'a str>,
    nodes: Vec<XmlNode>,
    attributes: Vec<(u16, Cow<'a, str>)>,
    texts: Vec<Cow<'a, str>>,
    kept: Cell<usize>,
}

impl<'a> Document<'a> {
    /// Parses a text.
    ///
    /// # Errors
    ///
    /// It is not well-formed, or larger than the limits.
    pub(crate) fn parse(text: &'a str) -> Result<Self, FileFault> {
        Parser::new(text).run()
    }

    /// Returns the outermost element.
    pub(crate) fn root(&self) -> Element<'_> {
        Element { document: self, index: 0 }
    }
}

struct Parser<'a> {
    text: &'a str,
    document: Document<'a>,
    by_name: HashMap<&'a str, u16>,
    open: Vec<usize>,
    line: u32,
    counted: usize,
}

impl<'a> Parser<'a> {
    fn new(text: &'a str) -> Self {
        let tags = text.matches('<').count();
        let values = text.matches('=').count();
        let document = Document {
            names: Vec::new(),
            nodes: Vec::with_capacity(tags.min(MOST_ELEMENTS)),
            attributes: Vec::with_capacity(values.min(MOST_ATTRIBUTES)),
            texts: Vec::with_capacity((tags / 2 + 1).min(MOST_ELEMENTS)),
            kept: Cell::new(0),
        };
        Self { text, document, by_name: HashMap::new(), open: Vec::new(), line: 1, counted: 0 }
    }

    fn run(mut self) -> Result<Document<'a>, FileFault> {
        let mut reader = Reader::from_str(self.text);
        let mut pieces = 0;
        loop {
            pieces += 1;
            if pieces > MOST_PIECES {
                return Err(self.finding(format!("more than {MOST_PIECES} tags and texts; split the file")));
            }
            let start = position(reader.buffer_position());
            let event = reader.read_event();
            self.count_lines(start);
            let end = position(reader.buffer_position());
            let raw = self.text.get(start..end).unwrap_or_default();
            match event {
                Ok(Event::Start(_)) => self.open(raw, 1)?,
                Ok(Event::Empty(_)) => {
                    self.open(raw, 2)?;
                    self.close();
                }
                Ok(Event::End(_)) => self.close(),
                Ok(Event::Text(_) | Event::GeneralRef(_)) => {
                    let text = unescape(raw).map_err(|_| self.finding(not_an_entity(raw)))?;
                    self.append(text);
                }
                Ok(Event::CData(_)) => {
                    let inner = raw.strip_prefix("<![CDATA[").and_then(|raw| raw.strip_suffix("]]>"));
                    self.append(Cow::Borrowed(inner.unwrap_or_default()));
                }
                Ok(Event::Eof) => break,
                Ok(Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_)) => {}
                Err(error) => {
                    self.count_lines(position(reader.error_position()));
                    return Err(self.finding(format!("{error}; correct the XML")));
                }
            }
        }
        if !self.open.is_empty() {
            return Err(self.finding("the element does not end; the file is cut"));
        }
        if self.document.nodes.is_empty() {
            return Err(FileFault::of_file("no XML element; expected a GSDML, EDS or ESI file"));
        }
        Ok(self.document)
    }

    fn count_lines(&mut self, until: usize) {
        let passed = self.text.as_bytes().get(self.counted..until).unwrap_or_default();
        // The text is shorter than MOST_BYTES.
        self.line += passed.iter().filter(|byte| **byte == b'\n').count() as u32;
        self.counted = self.counted.max(until);
    }

    fn finding(&self, fault: impl Display) -> FileFault {
        let element = self.open.last().map_or("file", |index| self.name_of(*index));
        FileFault::new(self.line as usize, element, fault)
    }

    fn name_of(&self, index: usize) -> &'a str {
        let node = self.document.nodes.get(index);
        node.and_then(|node| self.document.names.get(usize::from(node.name))).copied().unwrap_or_default()
    }

    /// Returns the number of a name, without its prefix.
    fn name(&mut self, name: &'a str) -> Result<u16, FileFault> {
        let name = name.rsplit(':').next().unwrap_or(name);
        if let Some(number) = self.by_name.get(name) {
            return Ok(*number);
        }
        let number = self.document.names.len();
        if number >= MOST_NAMES {
            return Err(
                self.finding(format!("more than {MOST_NAMES} different names of elements and attributes"))
            );
        }
        self.document.names.push(name);
        self.by_name.insert(name, number as u16);
        Ok(number as u16)
    }

    /// Opens an element from its tag, which ends with `closing` characters.
    fn open(&mut self, tag: &'a str, closing: usize) -> Result<(), FileFault> {
        if self.document.nodes.len() >= MOST_ELEMENTS {
            return Err(self.finding(format!("more than {MOST_ELEMENTS} elements; split the file")));
        }
        if self.open.len() >= MOST_DEPTH {
            return Err(self.finding(format!("elements within elements deeper than {MOST_DEPTH}")));
        }
        if self.open.is_empty() && !self.document.nodes.is_empty() {
            return Err(self.finding("a second outermost element; a file has one"));
        }
        let inner = tag.get(1..tag.len().saturating_sub(closing)).unwrap_or_default();
        let end = inner.find(|it: char| it.is_ascii_whitespace()).unwrap_or(inner.len());
        let name = self.name(inner.get(..end).unwrap_or_default())?;
        let first_attribute = self.document.attributes.len();
        self.open.push(self.document.nodes.len());
        let node = XmlNode {
            name,
            attributes: 0,
            first_attribute: first_attribute as u32,
            line: self.line,
            end: 0,
            text: None,
        };
        self.document.nodes.push(node);
        let count = self.attributes(inner, end)?;
        if let Some(node) = self.document.nodes.last_mut() {
            node.attributes = count;
        }
        Ok(())
    }

    fn attributes(&mut self, inner: &'a str, name_end: usize) -> Result<u16, FileFault> {
        let mut attributes = Attributes::new(inner, name_end);
        // The check compares each with each; the first of two of the same name counts.
        attributes.with_checks(false);
        let mut count = 0_u16;
        for attribute in attributes {
            let attribute = attribute.map_err(|error| self.finding(format!("{error}; correct the XML")))?;
            let (key, raw) = (attribute.key.0, attribute.value);
            let value = match raw {
                Cow::Borrowed(raw) => unescape(raw),
                Cow::Owned(raw) => unescape(&raw).map(|value| Cow::Owned(value.into_owned())),
            };
            let value = value
                .map_err(|_| self.finding(format!("attribute {}: {}", excerpt(key), not_an_entity(inner))))?;
            if self.document.attributes.len() >= MOST_ATTRIBUTES || count == u16::MAX {
                return Err(self.finding(format!("more than {MOST_ATTRIBUTES} attributes; split the file")));
            }
            let name = self.name(key)?;
            self.document.attributes.push((name, value));
            count += 1;
        }
        Ok(count)
    }

    fn close(&mut self) {
        let end = self.document.nodes.len() as u32;
        if let Some(node) = self.open.pop().and_then(|index| self.document.nodes.get_mut(index)) {
            node.end = end;
        }
    }

    fn append(&mut self, text: Cow<'a, str>) {
        if text.trim().is_empty() {
            return;
        }
        let Some(node) = self.open.last().and_then(|index| self.document.nodes.get_mut(*index)) else {
            return;
        };
        match node.text.and_then(|index| self.document.texts.get_mut(index as usize)) {
            Some(before) => before.to_mut().push_str(&text),
            None => {
                node.text = Some(self.document.texts.len() as u32);
                self.document.texts.push(text);
            }
        }
    }
}

/// Describes a text with a reference that XML does not define.
fn not_an_entity(text: &str) -> String {
    let found = text.split('&').nth(1).and_then(|text| text.split(';').next()).unwrap_or_default();
    format!("`&{};`: not an entity of XML; write `&` as `&amp;`", excerpt(found))
}

/// The text is in memory, so its positions fit.
fn position(offset: u64) -> usize {
    usize::try_from(offset).unwrap_or(usize::MAX)
}

/// Element of a tree.
#[derive(Clone, Copy)]
pub(crate) struct Element<'d> {
    document: &'d Document<'d>,
    index: usize,
}

impl<'d> Element<'d> {
    fn node(self) -> Option<&'d XmlNode> {
        self.document.nodes.get(self.index)
    }

    pub(crate) fn name(self) -> &'d str {
        let name = self.node().and_then(|node| self.document.names.get(usize::from(node.name)));
        name.copied().unwrap_or_default()
    }

    pub(crate) fn line(self) -> usize {
        self.node().map_or(0, |node| node.line as usize)
    }

    /// Returns the text of the element itself, without blanks around it.
    pub(crate) fn text(self) -> &'d str {
        let text = self.node().and_then(|node| self.document.texts.get(node.text? as usize));
        text.map_or("", |text| text.trim())
    }

    pub(crate) fn attribute(self, name: &str) -> Option<&'d str> {
        let node = self.node()?;
        let first = node.first_attribute as usize;
        let own = self.document.attributes.get(first..first + usize::from(node.attributes))?;
        let found = own
            .iter()
            .find(|(key, _)| self.document.names.get(usize::from(*key)).is_some_and(|key| *key == name))?;
        Some(found.1.trim())
    }

    /// Returns the elements directly within.
    pub(crate) fn children(self) -> impl Iterator<Item = Self> + 'd {
        let end = self.node().map_or(0, |node| node.end as usize);
        let mut next = self.index + 1;
        std::iter::from_fn(move || {
            let child = Self { document: self.document, index: next };
            let node = child.node().filter(|_| next < end)?;
            next = node.end as usize;
            Some(child)
        })
    }

    pub(crate) fn children_named(self, name: &str) -> impl Iterator<Item = Self> {
        self.children().filter(move |child| child.name() == name)
    }

    /// Returns the first element of a name directly within.
    pub(crate) fn child(self, name: &str) -> Option<Self> {
        self.children().find(|child| child.name() == name)
    }

    /// Returns the element at the end of a path of first children.
    pub(crate) fn at(self, path: &[&str]) -> Option<Self> {
        path.iter().try_fold(self, |element, name| element.child(name))
    }

    /// Returns the text of a child, if it has one.
    pub(crate) fn child_text(self, name: &str) -> Option<&'d str> {
        self.child(name).map(Self::text).filter(|text| !text.is_empty())
    }

    /// Returns a fault of this element, which is named with its ID.
    pub(crate) fn finding(self, fault: impl Display) -> FileFault {
        let element = match self.attribute("ID") {
            Some(id) => format!("{} {}", self.name(), excerpt(id)),
            None => self.name().to_owned(),
        };
        FileFault::new(self.line(), element, fault)
    }

    /// Returns an attribute that must be there.
    pub(crate) fn required(self, name: &str) -> Result<&'d str, FileFault> {
        self.attribute(name).ok_or_else(|| self.finding(format!("attribute {name} is missing; add it")))
    }

    /// Returns a number from an attribute, if it is there.
    pub(crate) fn number<N: TryFrom<i64>>(self, name: &str) -> Result<Option<N>, FileFault> {
        let Some(text) = self.attribute(name).filter(|text| !text.is_empty()) else { return Ok(None) };
        let fault = || self.finding(format!("{name} `{}`: must be {}", excerpt(text), range::<N>()));
        number(text).map(Some).ok_or_else(fault)
    }

    /// Returns a number from an attribute that must be there.
    pub(crate) fn required_number<N: TryFrom<i64>>(self, name: &str) -> Result<N, FileFault> {
        self.required(name)?;
        self.number(name)?.ok_or_else(|| self.finding(format!("{name} is empty: must be {}", range::<N>())))
    }

    /// Returns a number from the text, if there is text.
    pub(crate) fn text_number<N: TryFrom<i64>>(self) -> Result<Option<N>, FileFault> {
        let text = self.text();
        let fault = || self.finding(format!("`{}`: must be {}", excerpt(text), range::<N>()));
        if text.is_empty() { Ok(None) } else { number(text).map(Some).ok_or_else(fault) }
    }

    /// Returns the number in a child's text, if there is one.
    pub(crate) fn child_number<N: TryFrom<i64>>(self, name: &str) -> Result<Option<N>, FileFault> {
        self.child(name).map_or(Ok(None), Self::text_number)
    }

    /// Returns a truth value from an attribute; false without it.
    pub(crate) fn is(self, name: &str) -> Result<bool, FileFault> {
        match self.attribute(name) {
            None | Some("" | "false" | "0" | "False" | "FALSE") => Ok(false),
            Some("true" | "1" | "True" | "TRUE") => Ok(true),
            Some(other) => Err(self.finding(format!("{name} `{}`: must be true or false", excerpt(other)))),
        }
    }

    /// Keeps a text for longer than the tree.
    pub(crate) fn keep(self, text: &str) -> Result<String, FileFault> {
        self.charge(text.len())?;
        Ok(text.to_owned())
    }

    /// Keeps a text, if there is one.
    pub(crate) fn keep_some(self, text: Option<&str>) -> Result<Option<String>, FileFault> {
        text.map(|text| self.keep(text)).transpose()
    }

    /// Counts bytes that the reader keeps.
    pub(crate) fn charge(self, bytes: usize) -> Result<(), FileFault> {
        let kept = self.document.kept.get().saturating_add(bytes);
        self.document.kept.set(kept);
        if kept > MOST_KEPT {
            return Err(
                self.finding(format!("the description is larger than {MOST_KEPT} bytes; split the file"))
            );
        }
        Ok(())
    }

    /// Reads every child of a name.
    pub(crate) fn list<T>(
        self,
        name: &str,
        mut read: impl FnMut(Self) -> Result<T, FileFault>,
    ) -> Result<Vec<T>, FileFault> {
        let mut list = Vec::new();
        for child in self.children_named(name) {
            child.charge(size_of::<T>())?;
            list.push(read(child)?);
        }
        Ok(list)
    }
}

/// Parses a number as GSDML (`0x1A`), ESI (`#x1A`) and both (`26`, `-1`) write it; some ESIs have `#x0x1A`.
pub(crate) fn number<N: TryFrom<i64>>(text: &str) -> Option<N> {
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |digits| (-1, digits));
    let hex = ["#x0x", "0x", "0X", "#x", "#X"].iter().find_map(|prefix| digits.strip_prefix(prefix));
    let value = match hex {
        Some(digits) if digits.bytes().all(|it| it.is_ascii_hexdigit()) => {
            i64::from_str_radix(digits, 16).ok()?
        }
        None if digits.bytes().all(|it| it.is_ascii_digit()) => digits.parse().ok()?,
        _ => return None,
    };
    N::try_from(sign * value).ok()
}

/// Describes the numbers of a type.
fn range<N: TryFrom<i64>>() -> String {
    let fits = |value: i64| N::try_from(value).is_ok();
    match () {
        () if fits(-1) => "a whole number".to_owned(),
        () => {
            let largest = [0xFF, 0xFFFF, 0xFFFF_FFFF_i64].into_iter().rev().find(|it| fits(*it));
            largest.map_or("a whole number".to_owned(), |largest| format!("a number from 0 to {largest}"))
        }
    }
}
