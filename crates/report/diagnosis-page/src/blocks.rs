//! What pages without a case of their own are made of: head, sections, tables, and lists of what was asked.

use super::markup::Markup;

/// Writes the head: a title and what is to be said first.
pub(crate) fn head(m: &mut Markup, title: &str, content: impl FnOnce(&mut Markup)) {
    m.inside("header", &[], |m| {
        m.inside("div", &[], |m| {
            m.leaf("p", &[("class", &"brand")], "DreamStream gap diagnosis");
            m.leaf("h1", &[], title);
            content(m);
        });
    });
}

/// Writes a section.
pub(crate) fn section(m: &mut Markup, title: &str, content: impl FnOnce(&mut Markup)) {
    m.inside("section", &[], |m| {
        m.leaf("h2", &[], title);
        content(m);
    });
}

/// Writes a table.
pub(crate) fn table(m: &mut Markup, title: &str, columns: &[&str], rows: &[Vec<String>]) {
    m.inside("div", &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &title)], |m| {
        m.inside("table", &[], |m| {
            m.inside("thead", &[], |m| {
                m.inside("tr", &[], |m| columns.iter().for_each(|c| m.leaf("th", &[("scope", &"col")], c)));
            });
            m.inside("tbody", &[], |m| {
                for row in rows {
                    m.inside("tr", &[], |m| row.iter().for_each(|cell| m.leaf("td", &[], cell)));
                }
            });
        });
    });
}

/// Writes what was asked, line by line.
pub(crate) fn asked(m: &mut Markup, lines: &[(&str, String)]) {
    section(m, "What was asked", |m| {
        m.inside("dl", &[], |m| {
            for (what, value) in lines {
                m.leaf("dt", &[], what);
                m.leaf("dd", &[], value);
            }
        });
    });
}
