//! The page of a review: each variant from above, its time to collision, where it stands, and the command that says more.

use ds_page::{Document, Markup, Pictures, link, svg};

use super::{Review, Standing};
use crate::manifest::{Entry, Manifest};
use crate::quality::Severity;

/// Size of a plot, in pixels.
const PLOT_PX: (f64, f64) = (420.0, 130.0);
/// Room for the scales of a plot, in pixels: left and bottom.
const ROOM_PX: (f64, f64) = (34.0, 22.0);
/// The longest time to collision that is shown, in seconds.
const MOST_SECS: f64 = 4.0;

/// What is shown of a variant.
#[derive(Debug)]
pub struct Card<'a> {
    /// Its entry.
    pub entry: &'a Entry,
    /// The animation, from the page's folder.
    pub picture: String,
    /// Length of a tick, in seconds.
    pub dt_secs: f64,
    /// The tick from which the adversary attacks.
    pub attack: u32,
    /// The tick of the first contact with the logged ego and the speed of approach there, in metres per second.
    pub contact: Option<(u32, f64)>,
    /// Time to collision of each tick, in seconds; none beyond 4 s.
    pub ttc_secs: Vec<Option<f64>>,
    /// Which traffic rules the adversary breaks, in words.
    pub broken: String,
    /// How hard it is to survive, where the set's figures lie beside its manifest.
    pub severity: Option<Severity>,
}

impl Card<'_> {
    /// Returns the time of a tick since the hand-over, in seconds.
    fn since(&self, tick: u32) -> f64 {
        (f64::from(tick) - f64::from(self.entry.hand_over)) * self.dt_secs
    }

    /// Returns the least time to collision from the hand-over on before the contact, in seconds; nothing if it stays over 4 s.
    fn least_ttc_secs(&self) -> Option<f64> {
        let end = self.contact.map_or(self.ttc_secs.len(), |(tick, _)| tick as usize);
        let before = self.ttc_secs.get(self.entry.hand_over as usize..end.min(self.ttc_secs.len()))?;
        before.iter().flatten().copied().reduce(f64::min)
    }
}

/// Returns the page; `manifest` is how the command names the manifest.
#[must_use]
pub fn page(set: &Manifest, review: &Review, cards: &[Card], manifest: &str) -> String {
    let document = Document {
        title: "Review of variants",
        style: include_str!("page.css"),
        script: Some(include_str!("page.js")),
        pictures: Pictures::Beside,
    };
    document.page(|m| {
        m.inside("header", &[], |m| {
            m.inside("div", &[], |m| {
                m.leaf("h1", &[], format_args!("Review of {}", set.name));
                m.leaf(
                    "p",
                    &[("class", &"lead")],
                    "Each variant along the logged drive, all others as logged. Accept what could happen on a road; reject \
                     what could not, with a reason. Verdicts belong to the adversary: one that is made anew is unreviewed.",
                );
                m.leaf(
                    "p",
                    &[("class", &"lead")],
                    "The curves are the time to collision in seconds over the seconds since the hand-over; dotted is the attack, \
                     red the contact.",
                );
                m.leaf("p", &[], review.told(set));
            });
        });
        m.inside("main", &[], |m| {
            cards.iter().for_each(|card| write_card(m, card, &review.standing(card.entry)));
            m.inside("section", &[("id", &"command"), ("data-manifest", &manifest)], |m| {
                m.leaf("h2", &[], "Say it");
                m.leaf("p", &[("class", &"note")], "What was chosen above, as a command. Run it where the manifest lies.");
                m.leaf("code", &[("id", &"says")], format_args!("dreamstream benchmark review {manifest}"));
            });
        });
    })
}

fn write_card(m: &mut Markup, card: &Card, standing: &Standing) {
    let entry = card.entry;
    let (class, words) = match standing {
        Standing::Unreviewed => ("standing", "unreviewed".to_owned()),
        Standing::Accepted => ("standing good", "accepted".to_owned()),
        Standing::Rejected(reason) => ("standing alarm", format!("rejected: {reason}")),
    };
    m.inside("section", &[("class", &"card"), ("data-name", &entry.name)], |m| {
        m.inside("figure", &[], |m| {
            let told = format!("{} from above", entry.name);
            m.void("img", &[("src", &link(&card.picture)), ("alt", &told), ("loading", &"lazy")]);
        });
        m.inside("div", &[], |m| {
            m.leaf("h2", &[], &entry.name);
            m.leaf("p", &[("class", &class)], words);
            m.inside("dl", &[], |m| {
                let digest = entry.adversary_digest.as_deref().unwrap_or("none");
                let contact = card.contact.map_or("none".to_owned(), |(tick, closing_mps)| {
                    format!("{:.1} s after the hand-over, closing at {closing_mps:.1} m/s", card.since(tick))
                });
                let least = card.least_ttc_secs().map_or("over 4 s".to_owned(), |least| format!("{least:.1} s"));
                let attack = format!("{:.1} s after the hand-over", card.since(card.attack));
                let told = |secs: Option<f64>, none: &str| secs.map_or(none.to_owned(), |secs| format!("{secs:.1} s"));
                let margin = told(card.severity.and_then(|severity| severity.margin_secs), "unknown");
                let missed = card.severity.map_or("unknown".to_owned(), |severity| {
                    told(
                        severity.post_encroachment_secs,
                        "nothing told: their ways do not cross, or the set is an old one",
                    )
                });
                for (name, value) in [
                    ("class", entry.category.as_str()),
                    ("attack", attack.as_str()),
                    ("contact", contact.as_str()),
                    ("least time to collision", least.as_str()),
                    ("an expert may still react after the threat for", margin.as_str()),
                    ("the expert's drive misses it by", missed.as_str()),
                    ("rules that it breaks", card.broken.as_str()),
                    ("adversary", svg::short(digest, 16).as_str()),
                ] {
                    m.leaf("dt", &[], name);
                    m.leaf("dd", &[], value);
                }
            });
            plot(m, card);
            m.inside("p", &[("class", &"choice")], |m| {
                for (value, told) in [("accept", "accept"), ("reject", "reject"), ("", "say nothing")] {
                    m.inside("label", &[], |m| {
                        m.void("input", &[("type", &"radio"), ("name", &entry.name), ("value", &value)]);
                        m.text(told);
                    });
                }
                let told = format!("reason to reject {}", entry.name);
                m.void("input", &[("type", &"text"), ("placeholder", &"reason"), ("aria-label", &told)]);
            });
        });
    });
    m.raw("\n");
}

/// Draws the time to collision over the time since the hand-over, with the attack and the contact.
fn plot(m: &mut Markup, card: &Card) {
    let first = card.entry.hand_over as usize;
    let shown = card.ttc_secs.get(first..).unwrap_or_default();
    let last_secs = (shown.len().max(2) - 1) as f64 * card.dt_secs;
    let x = |secs: f64| ROOM_PX.0 + (PLOT_PX.0 - ROOM_PX.0 - 6.0) * (secs / last_secs).clamp(0.0, 1.0);
    let floor = PLOT_PX.1 - ROOM_PX.1;
    let y = |secs: f64| floor - (floor - 8.0) * (secs / MOST_SECS).clamp(0.0, 1.0);
    svg::picture(m, "ttc", "Time to collision, in seconds", PLOT_PX, |m| {
        for secs in [0.0, 2.0, 4.0] {
            svg::line(m, "grid", (ROOM_PX.0, y(secs)), (PLOT_PX.0 - 6.0, y(secs)));
            svg::text(m, "tick end", (ROOM_PX.0 - 6.0, y(secs) + 4.0), &format!("{secs:.0} s"));
        }
        let mut secs = 0.0;
        while secs <= last_secs + 1e-9 {
            svg::text(m, "tick", (x(secs), PLOT_PX.1 - 6.0), &format!("{secs:.0}"));
            secs += 2.0;
        }
        svg::line(m, "attack", (x(card.since(card.attack)), 8.0), (x(card.since(card.attack)), floor));
        if let Some((tick, _)) = card.contact {
            svg::line(m, "contact", (x(card.since(tick)), 8.0), (x(card.since(tick)), floor));
        }
        let mut run: Vec<(f64, f64)> = Vec::new();
        for (index, ttc_secs) in shown.iter().enumerate() {
            match ttc_secs {
                Some(ttc_secs) => run.push((x(index as f64 * card.dt_secs), y(*ttc_secs))),
                None => draw(m, &mut run),
            }
        }
        draw(m, &mut run);
    });
}

/// Draws what was gathered of a line, and begins anew.
fn draw(m: &mut Markup, run: &mut Vec<(f64, f64)>) {
    match run.as_slice() {
        [] => {}
        [alone] => svg::dot(m, "course", *alone, 2.0),
        points => svg::path(m, "course", points),
    }
    run.clear();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{Kind, Recipe};

    #[test]
    fn a_page_shows_each_variant_and_runs_nothing_but_its_own() {
        let entry = Entry {
            adversary_digest: Some("0123456789abcdef0123".to_owned()),
            category: "rear-end".to_owned(),
            ..crate::manifest::tests::entry("a<b>", "Apache-2.0")
        };
        let set = Manifest::new("some", Kind::Behavior, Recipe::default(), vec![entry]);
        let review = Review { set: "some".to_owned(), by: Vec::new() };
        let ttc_secs = (0..=100).map(|tick| (tick > 50 && tick != 60).then(|| 0.05 * f64::from(100 - tick))).collect();
        let card = Card {
            entry: &set.entries[0],
            picture: "a.gif".to_owned(),
            dt_secs: 0.1,
            attack: 40,
            contact: Some((70, 3.21)),
            ttc_secs,
            broken: "crosses a red light".to_owned(),
            severity: Some(Severity {
                margin_secs: Some(2.25),
                post_encroachment_secs: Some(0.52),
                ..Severity::default()
            }),
        };
        let page = page(&set, &review, &[card], "some.set.json");
        for part in [
            "a&lt;b&gt;",
            "unreviewed",
            "closing at 3.2 m/s",
            "crosses a red light",
            "1.6 s",
            "<dd>2.2 s</dd>",
            "<dd>0.5 s</dd>",
            "5.0 s after the hand-over",
            "src=\"./a.gif\"",
            "0123456789abcdef…",
            "review some.set.json",
        ] {
            assert!(page.contains(part), "{part} is missing");
        }
        assert!(!page.contains("a<b>") && page.matches("<polyline class=\"course\"").count() == 2);
    }
}
