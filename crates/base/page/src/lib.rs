//! Pages: the skeleton of a document, marks of SVG, and HTML as nested calls: balanced and escaped by construction, whatever the text is.
//!
//! Text and attribute values are escaped; control characters and those that turn the direction of writing become
//! U+FFFD, so that a name can neither break out of its place nor rearrange what stands around it. Only text that is
//! part of the program (`&'static str`) can be written raw.

mod document;
pub mod level;
pub mod svg;

use std::fmt::Display;

pub use document::{Document, Pictures, sections};

/// The script that sorts tables of class `sortable` by a click on a heading; comes first in a page's script.
pub const SORTING: &str = include_str!("sorting.js");

/// Names and values of an element's attributes.
pub type Attributes<'a> = &'a [(&'static str, &'a dyn Display)];

/// A document under construction.
#[derive(Debug, Default)]
pub struct Markup {
    out: String,
}

impl Markup {
    /// Returns the document.
    #[must_use]
    pub fn finish(self) -> String {
        self.out
    }

    /// Writes an element with what `content` writes inside.
    pub fn inside(&mut self, tag: &'static str, attributes: Attributes, content: impl FnOnce(&mut Self)) {
        self.start(tag, attributes);
        self.out.push('>');
        content(self);
        self.out += &format!("</{tag}>");
    }

    /// Writes an element that holds text only.
    pub fn leaf(&mut self, tag: &'static str, attributes: Attributes, text: impl Display) {
        self.inside(tag, attributes, |m| m.text(text));
    }

    /// Writes an element that holds nothing.
    pub fn void(&mut self, tag: &'static str, attributes: Attributes) {
        self.start(tag, attributes);
        self.out += "/>";
    }

    /// Writes text.
    pub fn text(&mut self, text: impl Display) {
        self.out += &escaped(&text.to_string());
    }

    /// Writes text of the program as it is.
    pub fn raw(&mut self, text: &'static str) {
        self.out += text;
    }

    fn start(&mut self, tag: &'static str, attributes: Attributes) {
        self.out += &format!("<{tag}");
        for (name, value) in attributes {
            self.out += &format!(" {name}=\"{}\"", escaped(&value.to_string()));
        }
    }
}

/// Returns text that is safe inside an element and inside a quoted attribute.
#[must_use]
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            '\n' | '\t' => out.push(c),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{200e}' | '\u{200f}' => out.push('\u{fffd}'),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Returns a relative path as a link: every byte but letters, digits, `-_.~/` is percent-encoded, and the leading `./`
/// keeps any name from being read as a scheme, a host or an absolute path.
#[must_use]
pub fn link(path: &str) -> String {
    let mut out = "./".to_owned();
    for byte in path.trim_start_matches(['/', '\\']).replace('\\', "/").bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' | b'/' => out.push(char::from(byte)),
            byte => out += &format!("%{byte:02X}"),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_text() {
        for (text, expected) in [
            ("</script><script>x</script>", "&lt;/script&gt;&lt;script&gt;x&lt;/script&gt;"),
            ("\" onload='x'", "&quot; onload=&#39;x&#39;"),
            ("&amp;", "&amp;amp;"),
            ("a\u{202e}b\u{0}c\r", "a\u{fffd}b\u{fffd}c\u{fffd}"),
        ] {
            assert_eq!(escaped(text), expected);
        }
    }

    #[test]
    fn links_stay_in_the_folder() {
        for (path, expected) in [
            ("pictures/cut-in.gif", "./pictures/cut-in.gif"),
            ("javascript:alert(1)", "./javascript%3Aalert%281%29"),
            ("//evil.example/x", "./evil.example/x"),
            ("\\\\evil\\x", "./evil/x"),
            ("pictures/a b\"#?.gif", "./pictures/a%20b%22%23%3F.gif"),
        ] {
            assert_eq!(link(path), expected);
        }
    }

    #[test]
    fn elements_nest() {
        let mut m = Markup::default();
        m.inside("p", &[("title", &"a\"b")], |m| {
            m.leaf("b", &[], "<x>");
            m.void("br", &[]);
        });
        assert_eq!(m.finish(), "<p title=\"a&quot;b\"><b>&lt;x&gt;</b><br/></p>");
    }
}
