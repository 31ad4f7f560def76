//! The elements of an XDMF file, and the paths by which they refer to each other: XPointer as FEniCS and meshio write it,
//! `Reference` as the XDMF library does.

use crate::error::Diagnostic;
use quick_xml::Reader;
use quick_xml::escape::unescape;
use quick_xml::events::{BytesStart, Event};
use std::cell::Cell;

/// Elements that paths may look at in all: a file of a million of them that refer to each other must end too.
const MAX_VISITS: usize = 50_000_000;

/// An element.
struct Element<'a> {
    tag: BytesStart<'a>,
    /// What stands between its tag and the next one.
    text: &'a str,
    children: Vec<u32>,
}

/// All elements; the first is the document.
pub(super) struct Tree<'a> {
    elements: Vec<Element<'a>>,
    visits: Cell<usize>,
}

impl<'a> Tree<'a> {
    /// Reads the XML. Cost and memory are linear in the text.
    pub(super) fn parse(text: &'a str) -> Result<Self, Diagnostic> {
        let mut reader = Reader::from_str(text);
        let mut elements = vec![Element { tag: BytesStart::new(""), text: "", children: Vec::new() }];
        let mut open = vec![0_u32];
        loop {
            let place = format!("byte {}", reader.buffer_position());
            let event = reader.read_event().map_err(|e| Diagnostic::new(&place, "well-formed XML", e))?;
            let (tag, empty) = match event {
                Event::Start(tag) => (tag, false),
                Event::Empty(tag) => (tag, true),
                Event::End(_) => {
                    open.pop();
                    continue;
                }
                Event::Eof => break,
                _ => continue,
            };
            let rest = &text[reader.buffer_position() as usize..];
            let inner = if empty { "" } else { rest[..rest.find('<').unwrap_or(rest.len())].trim() };
            let at = elements.len() as u32;
            // The XML reader refuses an end without its start, so the document itself stays open.
            let parent = open.last().copied().unwrap_or_default();
            elements[parent as usize].children.push(at);
            elements.push(Element { tag, text: inner, children: Vec::new() });
            if !empty {
                open.push(at);
            }
        }
        if let [_, .., last] = open[..] {
            let name = String::from_utf8_lossy(elements[last as usize].tag.name().as_ref()).into_owned();
            let expected = format!("the end of {name} (a file that is cut short: was the program stopped?)");
            return Err(Diagnostic::new("end of the file", expected, "none"));
        }
        let root = elements[0].children.first().map(|at| elements[*at as usize].tag.name().as_ref().to_vec());
        if root.as_deref() != Some(b"Xdmf") {
            return Err(Diagnostic::new("root element", "Xdmf", "another document"));
        }
        Ok(Self { elements, visits: Cell::new(0) })
    }

    /// The name without its namespace.
    pub(super) fn name(&self, at: u32) -> &[u8] {
        let element = &self.elements[at as usize];
        let name = &element.tag[..element.tag.name().as_ref().len()];
        name.rsplit(|byte| *byte == b':').next().unwrap_or(name)
    }

    /// What stands between the tags.
    pub(super) fn text(&self, at: u32) -> &'a str {
        self.elements[at as usize].text
    }

    /// An attribute, trimmed.
    pub(super) fn attribute(&self, at: u32, name: &str) -> Option<String> {
        let value = self.elements[at as usize].tag.try_get_attribute(name).ok()??;
        let text = String::from_utf8_lossy(&value.value).into_owned();
        Some(unescape(&text).map_or(text.clone(), |plain| plain.into_owned()).trim().to_owned())
    }

    /// Elements directly within another.
    pub(super) fn children(&self, at: u32) -> &[u32] {
        &self.elements[at as usize].children
    }

    /// Those of a name.
    pub(super) fn named<'b>(&'b self, at: u32, name: &'b str) -> impl Iterator<Item = u32> + 'b {
        self.children(at).iter().copied().filter(move |child| self.name(*child) == name.as_bytes())
    }

    /// An element for messages: its kind, and the name where it has one.
    pub(super) fn place(&self, at: u32) -> String {
        let kind = String::from_utf8_lossy(self.name(at)).into_owned();
        self.attribute(at, "Name").map_or_else(|| kind.clone(), |name| format!("{kind} {name}"))
    }

    /// The elements that a path names: `/A/B[2]`, `//A[@Name="x"]/*[self::B or self::C]`, may be in `xpointer(...)`.
    pub(super) fn find(&self, path: &str) -> Result<Vec<u32>, Diagnostic> {
        let refused = |found: &str| {
            let shown: String = found.chars().take(120).collect();
            Diagnostic::new("reference", "a path such as /Xdmf/Domain/Grid[1]/Topology", shown)
        };
        let inner = path.trim().strip_prefix("xpointer(").and_then(|rest| rest.strip_suffix(')'));
        let mut rest = inner.unwrap_or(path).trim();
        let mut found = vec![0];
        while !rest.is_empty() {
            let step = rest.strip_prefix('/').ok_or_else(|| refused(path))?;
            let (deep, step) = step.strip_prefix('/').map_or((false, step), |step| (true, step));
            let end = end_of_step(step);
            rest = &step[end..];
            found = self.step(&found, deep, &step[..end]).ok_or_else(|| refused(path))?;
        }
        if found.is_empty() || found == [0] {
            Err(refused(&format!("{path}, which names none")))
        } else {
            Ok(found)
        }
    }

    /// The element that another refers to; none when it refers to none.
    pub(super) fn referred(&self, at: u32) -> Result<Option<u32>, Diagnostic> {
        let Some(reference) = self.attribute(at, "Reference") else { return Ok(None) };
        let path = if reference == "XML" { self.text(at) } else { &reference };
        Ok(Some(self.find(path)?[0]))
    }

    /// One step of a path, from every element found so far.
    fn step(&self, from: &[u32], deep: bool, step: &str) -> Option<Vec<u32>> {
        let (name, conditions) = step.split_at(step.find('[').unwrap_or(step.len()));
        let mut found = Vec::new();
        for start in from {
            let mut here: Vec<u32> = if deep { self.below(*start)? } else { self.children(*start).to_vec() };
            self.visit(here.len())?;
            here.retain(|at| name == "*" || self.name(*at) == name.as_bytes());
            let mut rest = conditions;
            while !rest.is_empty() {
                let (condition, after) = rest.strip_prefix('[')?.split_once(']')?;
                here = self.fulfilled(here, condition.trim())?;
                rest = after;
            }
            found.extend(here);
        }
        Some(found)
    }

    fn visit(&self, count: usize) -> Option<()> {
        self.visits.set(self.visits.get().saturating_add(count));
        (self.visits.get() <= MAX_VISITS).then_some(())
    }

    /// All elements within another, in the order of the file.
    fn below(&self, at: u32) -> Option<Vec<u32>> {
        let (mut open, mut found) = (self.children(at).to_vec(), Vec::new());
        open.reverse();
        while let Some(next) = open.pop() {
            self.visit(1)?;
            found.push(next);
            open.extend(self.children(next).iter().rev());
        }
        Some(found)
    }

    /// Those for which a condition holds: a position from 1, the value of an attribute, a name.
    fn fulfilled(&self, mut found: Vec<u32>, condition: &str) -> Option<Vec<u32>> {
        if let Ok(position) = condition.parse::<usize>() {
            return Some(found.get(position.checked_sub(1)?).copied().into_iter().collect());
        }
        if let Some((name, value)) = condition.strip_prefix('@').and_then(|rest| rest.split_once('=')) {
            let value = value.trim().trim_matches(['"', '\'']);
            found.retain(|at| self.attribute(*at, name.trim()).as_deref() == Some(value));
            return Some(found);
        }
        let names: Vec<&str> =
            condition.split(" or ").map(|name| name.trim().strip_prefix("self::")).collect::<Option<_>>()?;
        found.retain(|at| names.iter().any(|name| self.name(*at) == name.as_bytes()));
        Some(found)
    }
}

/// Where the next `/` outside of a condition begins.
fn end_of_step(path: &str) -> usize {
    let mut depth = 0_usize;
    for (at, byte) in path.bytes().enumerate() {
        match byte {
            b'[' => depth += 1,
            b']' => depth = depth.saturating_sub(1),
            b'/' if depth == 0 => return at,
            _ => {}
        }
    }
    path.len()
}
