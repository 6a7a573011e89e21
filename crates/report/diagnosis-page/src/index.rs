//! The index over many cases: how many of each verdict, then one row per case with a link to its page.
//!
//! The small bars of a row are the largest effect size per channel, in doubling levels of the noise floor: two gaps of
//! one cause look alike.

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::Diagnosis;
use ds_effect::Channel;

use super::headline::{at_floor, chosen, sure, telling, verdict};
use super::markup::{Markup, link};

use super::plot;
use super::tiles::{TILES, tiles};
use super::value;
use super::words;

const VERDICTS: [Verdict; 4] = [Verdict::None, Verdict::Single, Verdict::Multiple, Verdict::Unknown];

/// Writes the body of the index.
pub(crate) fn body(m: &mut Markup, cases: &[(String, Diagnosis)]) {
    m.inside("header", &[], |m| {
        m.inside("div", &[], |m| {
            m.leaf("p", &[("class", &"brand")], "DreamStream gap diagnosis");
            m.leaf("h1", &[], super::INDEX);
            m.inside("ul", &[("class", &"tiles")], |m| {
                tile(m, cases.len(), "cases", "");
                for kind in VERDICTS {
                    let count = cases.iter().filter(|(_, d)| d.verdict == kind).count();
                    tile(m, count, verdict(kind), if kind == Verdict::Unknown && count > 0 { "alarm" } else { "" });
                }
            });
        });
    });
    m.inside("main", &[], |m| {
        m.inside("section", &[], |m| {
            m.inside(
                "div",
                &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &"Cases")],
                |m| {
                    m.inside("table", &[("class", &"sortable index")], |m| table(m, cases));
                },
            );
        });
    });
}

/// Writes a count and what is counted.
pub(crate) fn tile(m: &mut Markup, count: usize, what: &str, class: &str) {
    m.inside("li", &[("class", &class)], |m| {
        m.leaf("b", &[], count);
        m.leaf("span", &[], what);
    });
}

fn table(m: &mut Markup, cases: &[(String, Diagnosis)]) {
    m.inside("thead", &[], |m| {
        m.inside("tr", &[], |m| {
            for (class, title) in [
                ("", "case"),
                ("", "verdict"),
                ("", "effects"),
                ("n", "estimate"),
                ("n", "sure"),
                ("n", "share explained"),
                ("", "of the gap in"),
            ] {
                m.inside("th", &[("scope", &"col"), ("class", &class)], |m| {
                    m.leaf("button", &[("type", &"button")], title)
                });
            }
            let hint = "largest effect size per channel or image tile, in doubling levels of the noise floor";
            m.inside("th", &[("scope", &"col"), ("title", &hint)], |m| {
                m.leaf("button", &[("type", &"button")], "where");
            });
        });
    });
    m.inside("tbody", &[], |m| {
        for (path, diagnosis) in cases {
            m.inside("tr", &[], |m| row(m, path, diagnosis));
            m.raw("\n");
        }
    });
}

fn row(m: &mut Markup, path: &str, diagnosis: &Diagnosis) {
    m.inside("th", &[("scope", &"row")], |m| {
        m.inside("a", &[("href", &link(path))], |m| m.leaf("bdi", &[], &diagnosis.case));
    });
    m.inside("td", &[], |m| {
        let class = match diagnosis.verdict {
            Verdict::None => "chip v-none",
            Verdict::Single => "chip v-single",
            Verdict::Multiple => "chip v-multiple",
            Verdict::Unknown => "chip v-unknown",
        };
        m.leaf("span", &[("class", &class)], verdict(diagnosis.verdict));
        if !diagnosis.warnings.is_empty() {
            let hint = diagnosis.warnings.join("\n");
            m.leaf(
                "span",
                &[("class", &"chip warn"), ("title", &hint)],
                format_args!("⚠ {}", diagnosis.warnings.len()),
            );
        }
    });
    let found = chosen(diagnosis);
    let first = found.first();
    let names = words::list(&found.iter().map(|f| words::effect(&f.id)).collect::<Vec<_>>());
    m.leaf("td", &[], if names.is_empty() { words::NOTHING.to_owned() } else { names });
    let estimate = first.and_then(|f| value::estimate(f));
    let (value, interval) = estimate.map_or((words::NOTHING.to_owned(), String::new()), |e| (e.value, e.interval));
    number(m, first.map(|f| f.value), &value, &interval);
    let sure = sure(diagnosis);
    number(m, Some(sure), &words::chance(sure), "");
    let told = telling(diagnosis).filter(|s| !at_floor(s) && !found.is_empty());
    let explained = told.and_then(|s| s.share_explained);
    let interval = told.and_then(|s| s.interval90).map(words::shares).unwrap_or_default();
    number(m, explained, &explained.map_or(words::NOTHING.to_owned(), words::share), &interval);
    m.leaf("td", &[], told.map_or(String::new(), |s| words::metric(&s.metric).0));
    m.inside("td", &[("class", &"axis")], |m| spark(m, diagnosis));
}

/// Writes a number with its interval below.
fn number(m: &mut Markup, value: Option<f64>, words: &str, interval: &str) {
    let sort = value.filter(|v| v.is_finite()).map(|v| v.to_string()).unwrap_or_default();
    m.inside("td", &[("class", &"n"), ("data-sort", &sort)], |m| {
        m.leaf("b", &[], words);
        m.leaf("small", &[], interval);
    });
}

/// Draws one bar per channel, or the image tiles where the gap is in the image.
fn spark(m: &mut Markup, diagnosis: &Diagnosis) {
    let place = |size: f64| if size > 0.5 { ((size / 0.5).log2() / 7.0).clamp(0.08, 1.0) } else { 0.0 };
    let tiles = tiles(diagnosis);
    if !tiles.is_empty() {
        plot::picture(m, "inline", "gap by image tile", (66.0, 30.0), |m| {
            for (row, column) in (0..TILES.0).flat_map(|row| (0..TILES.1).map(move |column| (row, column))) {
                let class = tiles.get(&[row, column]).map_or("h", |t| plot::level(t.0));
                plot::area(m, class, (11.0 * column as f64, 7.5 * row as f64), (10.0, 6.5), "");
            }
        });
        return;
    }
    plot::picture(m, "inline", "largest gap by channel", (11.0 * Channel::ALL.len() as f64, 30.0), |m| {
        for (k, channel) in Channel::ALL.iter().enumerate() {
            let sizes = diagnosis.cells.iter().filter(|c| c.channel == channel.name()).map(|c| c.effect_size);
            let size = sizes.filter(|s| s.is_finite()).fold(0.0, f64::max);
            let height = 26.0 * place(size);
            let words = format!("{}: {} × floor", words::channel(channel.name()), words::figure(size));
            plot::area(m, "h", (11.0 * k as f64, 28.0), (9.0, 2.0), "");
            if height > 0.0 {
                plot::area(m, plot::level(size), (11.0 * k as f64, 28.0 - height), (9.0, height), &words);
            }
        }
    });
}
