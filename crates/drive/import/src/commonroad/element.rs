//! The XML of a file as a bounded tree with typed access; every refusal names the element, as `lanelet[23].leftBound`.
//!
//! An element is told from those of its name by its `id`, else by its place among them. Document types, and with them
//! entities of a file's own, are refused; depth, count and lengths are bounded while reading.

use std::collections::BTreeSet;
use std::rc::Rc;

use ds_space::DVec2;
use xml::common::Position;
use xml::reader::{EventReader, ParserConfig, XmlEvent};

use crate::view::{FARTHEST_M, FieldFault};

const MOST_ELEMENTS: usize = 4_000_000;
const DEEPEST: usize = 32;
/// The most bytes of a text, an attribute or a name.
const LONGEST: usize = 1 << 14;

/// An element of a file.
#[derive(Debug, Default)]
pub(super) struct Element {
    name: Rc<str>,
    attributes: Vec<(String, String)>,
    text: String,
    children: Vec<Element>,
}

/// Reads a document and returns its root.
pub(super) fn read(bytes: &[u8]) -> Result<Element, FieldFault> {
    let config = ParserConfig::new()
        .trim_whitespace(true)
        .cdata_to_characters(true)
        .allow_multiple_root_elements(false)
        .max_entity_expansion_length(LONGEST)
        .max_entity_expansion_depth(1)
        .max_name_length(LONGEST)
        .max_attributes(64)
        .max_attribute_length(LONGEST)
        .max_data_length(LONGEST);
    let mut reader = EventReader::new_with_config(bytes, config);
    let mut tree = Tree { names: BTreeSet::new(), open: vec![Element::default()], count: 0 };
    loop {
        let event = reader.next();
        let here = reader.position();
        let refused =
            |problem: String| FieldFault { at: format!("line {}, column {}", here.row + 1, here.column + 1), problem };
        let event = event.map_err(|error| refused(format!("is no sound XML: {}", error.msg())))?;
        if reader.doctype().is_some() {
            return Err(refused("declares a document type, which CommonRoad has none of".to_owned()));
        }
        if event == XmlEvent::EndDocument {
            let root = tree.open.pop().and_then(|mut document| document.children.pop());
            return root.ok_or_else(|| refused("has no element".to_owned()));
        }
        tree.take(event).map_err(refused)?;
    }
}

/// A tree that grows: the elements that are open, the outermost standing for the document.
struct Tree {
    names: BTreeSet<Rc<str>>,
    open: Vec<Element>,
    count: usize,
}

impl Tree {
    fn take(&mut self, event: XmlEvent) -> Result<(), String> {
        match event {
            XmlEvent::StartElement { name, attributes, .. } => {
                self.count += 1;
                if self.count > MOST_ELEMENTS || self.open.len() > DEEPEST {
                    return Err(format!("has more than {MOST_ELEMENTS} elements, or {DEEPEST} one in another"));
                }
                let known: Option<Rc<str>> = self.names.get(name.local_name.as_str()).cloned();
                let name = known.unwrap_or_else(|| {
                    let name: Rc<str> = name.local_name.into();
                    self.names.insert(Rc::clone(&name));
                    name
                });
                let attributes = attributes.into_iter().map(|given| (given.name.local_name, given.value)).collect();
                self.open.push(Element { name, attributes, ..Element::default() });
            }
            XmlEvent::EndElement { .. } => {
                if let (Some(element), Some(parent)) = (self.open.pop(), self.open.last_mut()) {
                    parent.children.push(element);
                }
            }
            XmlEvent::Characters(text) => {
                if let Some(element) = self.open.last_mut() {
                    element.text.push_str(&text);
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// An element and the path to it.
#[derive(Debug, Clone)]
pub(super) struct Node<'a> {
    element: &'a Element,
    at: String,
}

impl<'a> Node<'a> {
    pub(super) fn root(element: &'a Element) -> Self {
        Self { element, at: element.name.to_string() }
    }

    pub(super) fn name(&self) -> &'a str {
        &self.element.name
    }

    pub(super) fn text(&self) -> &'a str {
        &self.element.text
    }

    pub(super) fn fault(&self, problem: impl Into<String>) -> FieldFault {
        FieldFault { at: self.at.clone(), problem: problem.into() }
    }

    /// Returns the value of an attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&'a str> {
        self.element.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    pub(super) fn need_attribute(&self, name: &str) -> Result<&'a str, FieldFault> {
        self.attribute(name).ok_or_else(|| self.fault(format!("has no attribute {name:?}")))
    }

    /// Returns the elements inside, in file order.
    pub(super) fn children(&self) -> impl Iterator<Item = Self> + use<'a> {
        // The root is in nobody's way: its parts are found by their ids.
        let above = if &*self.element.name == super::ROOT { String::new() } else { format!("{}.", self.at) };
        let all = &self.element.children;
        all.iter().enumerate().map(move |(i, element)| {
            let id =
                element.attributes.iter().find(|(name, _)| name == "id").map(|(_, id)| id.chars().take(24).collect());
            let alone = all.get(i + 1).is_none_or(|next| next.name != element.name)
                && (i == 0 || all[i - 1].name != element.name);
            let step: String =
                id.map_or_else(|| if alone { String::new() } else { format!("[{i}]") }, |id: String| format!("[{id}]"));
            Self { element, at: format!("{above}{}{step}", element.name) }
        })
    }

    /// Returns the elements of a name, in file order.
    pub(super) fn all(&self, name: &'a str) -> impl Iterator<Item = Self> + use<'a> {
        self.children().filter(move |child| child.name() == name)
    }

    /// Returns the first element of a name.
    pub(super) fn get(&self, name: &str) -> Option<Self> {
        let element = self.element.children.iter().find(|child| &*child.name == name)?;
        let above = if &*self.element.name == super::ROOT { String::new() } else { format!("{}.", self.at) };
        Some(Self { element, at: format!("{above}{name}") })
    }

    pub(super) fn need(&self, name: &str) -> Result<Self, FieldFault> {
        self.get(name).ok_or_else(|| self.fault(format!("has no {name:?}")))
    }

    /// Returns the number that the element's text is, finite and within [`FARTHEST_M`].
    pub(super) fn number(&self) -> Result<f64, FieldFault> {
        let shown = || self.text().chars().take(32).collect::<String>();
        let number: f64 = self.text().parse().map_err(|_error| self.fault(format!("is {:?}, no number", shown())))?;
        if number.abs() <= FARTHEST_M {
            Ok(number)
        } else {
            Err(self.fault(format!("is {}, no number within ±{FARTHEST_M}", shown())))
        }
    }

    /// Returns an exact value, or the middle of an interval.
    pub(super) fn value(&self) -> Result<f64, FieldFault> {
        let (low, high) = self.interval()?;
        Ok(low.midpoint(high))
    }

    /// Returns both ends of an interval, those of an exact value being the same.
    pub(super) fn interval(&self) -> Result<(f64, f64), FieldFault> {
        if let Some(exact) = self.get("exact") {
            let value = exact.number()?;
            return Ok((value, value));
        }
        let ends = (self.need("intervalStart")?.number()?, self.need("intervalEnd")?.number()?);
        if ends.0 <= ends.1 { Ok(ends) } else { Err(self.fault(format!("is the interval {} to {}", ends.0, ends.1))) }
    }

    /// Returns the last whole time step of an exact value or interval.
    pub(super) fn step(&self) -> Result<u32, FieldFault> {
        const LAST: f64 = 1e6;
        let (_, step) = self.interval()?;
        if (0.0..=LAST).contains(&step) && step.fract() == 0.0 {
            Ok(step as u32)
        } else {
            Err(self.fault(format!("is {step}, no whole time step from 0 to {LAST}")))
        }
    }

    /// Returns the place that elements `x` and `y` tell.
    pub(super) fn place(&self) -> Result<DVec2, FieldFault> {
        Ok(DVec2::new(self.need("x")?.number()?, self.need("y")?.number()?))
    }
}
