//! The skeleton of every page: title, content policy, style in light, dark and print, script, body.
//!
//! A page fetches nothing but pictures, and runs no script but its own. Common rules (`document.css`) come before a page's.

use crate::{Markup, SORTING};

const STYLE: &str = include_str!("document.css");

/// Where the pictures of a page are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pictures {
    /// Inside the page.
    Inside,
    /// In files beside the page, or inside it.
    Beside,
}

/// A page without its body.
#[derive(Debug, Clone, Copy)]
pub struct Document<'a> {
    /// What the page is about; the program's name is added.
    pub title: &'a str,
    /// The page's own rules; `--width` is the widest that its text may be.
    pub style: &'static str,
    /// The page's own script, which runs after that which sorts tables; none runs where there is none.
    pub script: Option<&'static str>,
    /// Where its pictures are.
    pub pictures: Pictures,
}

impl Document<'_> {
    /// Returns the page with what `body` writes.
    #[must_use]
    pub fn page(&self, body: impl FnOnce(&mut Markup)) -> String {
        let mut m = Markup::default();
        m.raw("<!DOCTYPE html>\n");
        m.inside("html", &[("lang", &"en")], |m| {
            m.inside("head", &[], |m| {
                m.void("meta", &[("charset", &"utf-8")]);
                m.void("meta", &[("http-equiv", &"Content-Security-Policy"), ("content", &self.policy())]);
                m.void("meta", &[("name", &"viewport"), ("content", &"width=device-width, initial-scale=1")]);
                m.leaf("title", &[], format_args!("{} · DreamStream", self.title));
                m.inside("style", &[], |m| {
                    m.raw(STYLE);
                    m.raw(self.style);
                });
            });
            m.inside("body", &[], |m| {
                body(m);
                if let Some(script) = self.script {
                    m.inside("script", &[], |m| {
                        m.raw(SORTING);
                        m.raw(script);
                    });
                }
            });
        });
        m.raw("\n");
        m.finish()
    }

    fn policy(&self) -> String {
        let pictures = match self.pictures {
            Pictures::Inside => "data:",
            Pictures::Beside => "'self' file: data:",
        };
        let script = if self.script.is_some() { "'unsafe-inline'" } else { "'none'" };
        format!(
            "default-src 'none'; img-src {pictures}; style-src 'unsafe-inline'; script-src {script}; base-uri 'none'; \
             form-action 'none'"
        )
    }
}

/// Writes the list of sections and the sections themselves, given by anchor and title; `content` writes what is in one.
pub fn sections(m: &mut Markup, parts: &[(&'static str, &str)], mut content: impl FnMut(&mut Markup, &'static str)) {
    m.inside("nav", &[("aria-label", &"Sections")], |m| {
        m.inside("ul", &[], |m| {
            for (id, title) in parts {
                m.inside("li", &[], |m| m.leaf("a", &[("href", &format_args!("#{id}"))], title));
            }
        });
    });
    m.inside("main", &[], |m| {
        for (id, title) in parts {
            m.inside("section", &[("id", id), ("aria-labelledby", &format_args!("{id}-title"))], |m| {
                m.leaf("h2", &[("id", &format_args!("{id}-title"))], title);
                content(m, id);
            });
            m.raw("\n");
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_forbids_what_it_does_not_need() {
        let plain = Document { title: "<a>", style: "i{}", script: None, pictures: Pictures::Inside };
        let page = plain.page(|m| m.leaf("p", &[], "text"));
        assert!(page.starts_with("<!DOCTYPE html>\n<html lang=\"en\">") && page.ends_with("</body></html>\n"));
        for part in
            ["img-src data:", "script-src &#39;none&#39;", "<title>&lt;a&gt; · DreamStream</title>", "i{}</style>"]
        {
            assert!(page.contains(part), "{part} is missing");
        }
        assert!(!page.contains("<script"));
        let page = Document { script: Some("run()"), pictures: Pictures::Beside, ..plain }.page(|_| ());
        for part in ["&#39;self&#39; file: data:", "script-src &#39;unsafe-inline&#39;", "run()</script>"] {
            assert!(page.contains(part), "{part} is missing");
        }
    }

    #[test]
    fn sections_are_listed_before_they_come() {
        let mut m = Markup::default();
        sections(&mut m, &[("one", "The first"), ("two", "The second")], |m, id| m.text(id.to_uppercase()));
        let text = m.finish();
        let places =
            ["href=\"#one\"", "href=\"#two\"", "id=\"one\"", "ONE", "id=\"two\"", "TWO"].map(|part| text.find(part));
        assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{text}");
    }
}
