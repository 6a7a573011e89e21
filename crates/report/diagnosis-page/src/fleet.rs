//! A fleet: which members differ from the others, by which effect, and how common each effect is; then every case.

use std::fmt::Write as _;

use ds_diagnosis::Diagnosis;
use ds_dynamics::fleet::{Fleet, Member, Suspicion};

use super::index::tile;
use super::markup::{Markup, link};
use super::words;

/// Returns the text.
pub(crate) fn text(fleet: &Fleet) -> String {
    let affected = fleet.members.iter().filter(|m| m.affected).count();
    let mut text = format!("{affected} of {} members differ ({})", fleet.members.len(), rate(fleet));
    for member in &fleet.members {
        let mark = if member.affected { "differs" } else { "like the others" };
        let _infallible = write!(text, "\n{:16} {mark:16} ", member.name);
        let said = member.effects.first().map(suspicion);
        text.push_str(&said.unwrap_or_default());
        if !member.unexplained.is_empty() {
            let _infallible = write!(text, "; unexplained: {}", member.unexplained.join(", "));
        }
    }
    for common in &fleet.effects {
        let share = words::share(common.share);
        let _infallible = write!(text, "\n{} in {share} of the members: {}", common.id, common.members.join(", "));
    }
    for warning in &fleet.warnings {
        let _infallible = write!(text, "\n! {warning}");
    }
    text
}

fn rate(fleet: &Fleet) -> String {
    format!("of such calls {} in a hundred may be false", 100.0 * fleet.false_discovery_rate)
}

fn suspicion(s: &Suspicion) -> String {
    let estimate = words::estimate(s.value, s.interval90, &s.unit).map(|e| format!(" {} {}", e.value, e.interval));
    format!("{}{} with probability {}", s.id, estimate.unwrap_or_default(), words::chance(s.probability))
}

/// Writes the body of the page.
pub(crate) fn body(m: &mut Markup, fleet: &Fleet, cases: &[Diagnosis]) {
    m.inside("header", &[], |m| {
        m.inside("div", &[], |m| {
            m.leaf("p", &[("class", &"brand")], "DreamStream gap diagnosis");
            m.leaf("h1", &[], "Which of the fleet differ");
            m.inside("ul", &[("class", &"tiles")], |m| {
                let affected = fleet.members.iter().filter(|m| m.affected).count();
                tile(m, fleet.members.len(), &format!("members, by {}", fleet.by), "");
                tile(m, affected, "differ", if affected > 0 { "alarm" } else { "" });
                tile(m, cases.len(), "cases", "");
            });
            m.leaf(
                "p",
                &[],
                format_args!("Each member is compared with the others that are like each other; {}.", rate(fleet)),
            );
            for warning in &fleet.warnings {
                m.leaf("p", &[("class", &"chip warn")], warning);
            }
        });
    });
    m.inside("main", &[], |m| {
        section(m, "Members", &["member", "", "effect", "estimate", "probability", "log e-value", "cases"], |m| {
            for member in &fleet.members {
                m.inside("tr", &[], |m| row(m, member, cases));
            }
        });
        if !fleet.effects.is_empty() {
            section(m, "How common", &["effect", "share of members", "mean", "members"], |m| {
                for common in &fleet.effects {
                    m.inside("tr", &[], |m| {
                        m.leaf("th", &[("scope", &"row")], words::effect(&common.id));
                        m.leaf("td", &[("class", &"n")], words::share(common.share));
                        m.leaf(
                            "td",
                            &[("class", &"n")],
                            format_args!("{} {}", words::figure(common.value), common.unit),
                        );
                        m.leaf("td", &[], common.members.join(", "));
                    });
                }
            });
        }
    });
}

fn section(m: &mut Markup, title: &str, columns: &[&str], rows: impl FnOnce(&mut Markup)) {
    m.inside("section", &[], |m| {
        m.leaf("h2", &[], title);
        m.inside("div", &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &title)], |m| {
            m.inside("table", &[("class", &"index")], |m| {
                m.inside("thead", &[], |m| {
                    m.inside("tr", &[], |m| columns.iter().for_each(|c| m.leaf("th", &[("scope", &"col")], c)));
                });
                m.inside("tbody", &[], rows);
            });
        });
    });
}

fn row(m: &mut Markup, member: &Member, cases: &[Diagnosis]) {
    m.leaf("th", &[("scope", &"row")], &member.name);
    let (class, mark) = if member.affected { ("chip v-single", "differs") } else { ("chip v-none", "like the others") };
    m.inside("td", &[], |m| {
        m.leaf("span", &[("class", &class)], mark);
        if !member.unexplained.is_empty() {
            m.leaf("span", &[("class", &"chip v-unknown")], "unexplained");
        }
    });
    let first = member.effects.first();
    m.leaf("td", &[], first.map_or(words::NOTHING.to_owned(), |s| words::effect(&s.id)));
    let estimate = first.and_then(|s| words::estimate(s.value, s.interval90, &s.unit));
    m.inside("td", &[("class", &"n")], |m| {
        m.leaf("b", &[], estimate.as_ref().map_or(words::NOTHING, |e| &e.value));
        m.leaf("small", &[], estimate.as_ref().map_or("", |e| &e.interval));
    });
    m.leaf("td", &[("class", &"n")], first.map_or(words::NOTHING.to_owned(), |s| words::chance(s.probability)));
    m.leaf("td", &[("class", &"n")], format_args!("{:.1}", member.log_e));
    m.inside("td", &[], |m| {
        for case in cases.iter().filter(|d| member.cases.contains(&d.case)) {
            m.inside("a", &[("href", &link(&format!("{}/report.html", case.case)))], |m| {
                m.leaf("bdi", &[], &case.case)
            });
            m.raw(" ");
        }
    });
}
