//! What tests of pages ask of any page.

const VOID: [&str; 3] = ["meta", "img", "input"];
const DRAWN: [&str; 5] = ["line", "circle", "rect", "polyline", "polygon"];

/// Checks that tags nest, that every quote closes and that every coordinate is a number; returns the tags met.
pub(crate) fn checked(page: &str) -> Vec<String> {
    let (mut open, mut met): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
    let mut rest = page.strip_prefix("<!DOCTYPE html>").expect("a doctype");
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let mut quoted = false;
        let end = rest.find(|c| {
            quoted ^= c == '"';
            c == '>' && !quoted
        });
        let (tag, after) = rest.split_at(end.expect("every tag ends"));
        let name: String = tag.trim_start_matches('/').chars().take_while(|c| c.is_ascii_alphanumeric()).collect();
        assert!(!name.is_empty(), "a stray < before {tag:?}");
        rest = after;
        numbers(tag);
        if tag.starts_with('/') {
            assert_eq!(open.pop().as_deref(), Some(name.as_str()), "{tag:?} closes something else");
        } else if tag.ends_with('/') {
            assert!(VOID.contains(&name.as_str()) || DRAWN.contains(&name.as_str()), "{name} is not void");
        } else {
            assert!(!VOID.contains(&name.as_str()), "{name} is left open");
            open.push(name.clone());
            if name == "style" || name == "script" {
                rest = &rest[rest.find("</").expect("it ends")..];
            }
        }
        met.push(name);
    }
    assert!(open.is_empty(), "left open: {open:?}");
    met
}

fn numbers(tag: &str) {
    const NUMERIC: [&str; 15] =
        ["x", "y", "x1", "x2", "y1", "y2", "cx", "cy", "r", "rx", "width", "height", "points", "viewBox", "data-t"];
    let mut parts = tag.split('"');
    while let (Some(name), Some(value)) = (parts.next(), parts.next()) {
        let name = name.trim_end_matches('=').rsplit(' ').next().unwrap_or_default();
        if NUMERIC.contains(&name) {
            for number in value.split([' ', ',']).filter(|n| !n.is_empty()) {
                let number: f64 = number.parse().unwrap_or(f64::NAN);
                assert!(number.is_finite(), "{name} of <{tag}> is {value:?}");
                assert!(number >= 0.0 || !["width", "height", "r"].contains(&name), "{name} of <{tag}> is negative");
            }
        }
    }
}
