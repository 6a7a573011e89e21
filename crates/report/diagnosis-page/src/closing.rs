//! What a correction of the simulator closes: drives kept from the fit, in the nominal and in the corrected simulator, each
//! against the real drive.

use ds_diagnosis::schema::Diagnosis;
use ds_run_report::closing::{Closing, Drive};

use super::blocks::{asked, head, section, table};
use super::markup::Markup;
use super::plot;
use super::words;

const LEFT: f64 = 230.0;
const RIGHT: f64 = 860.0;
const TOP: f64 = 34.0;
const ROW: f64 = 26.0;

/// Writes the body of the page; `report` is the page of the diagnosis, beside this one.
pub(crate) fn body(
    m: &mut Markup,
    diagnosis: &Diagnosis,
    closings: &[Closing],
    lines: &[(&str, String)],
    report: &str,
) {
    head(m, &format!("How far the corrected simulator comes closer: {}", diagnosis.case), |m| {
        m.leaf("p", &[("class", &"said")], said(diagnosis, closings));
        m.inside("p", &[], |m| {
            m.leaf("a", &[("href", &ds_page::link(report))], "The diagnosis that the correction is made from")
        });
    });
    m.inside("main", &[], |m| {
        closings.iter().for_each(|closing| metric(m, closing));
        asked(m, lines);
        section(m, "How to read this", |m| {
            m.leaf(
                "p",
                &[],
                "The scenarios below were kept from the fit. Each was driven again with the same policy in the nominal simulator and in \
                 the corrected one. A ring says how far the nominal drive lies from the real one, a dot how far the corrected one does: \
                 route deviation is the root mean square distance in metres at equal times, scores go from 0 to 1. Drives of a policy that sees frames part at the smallest difference: the bar at zero says how far two \
                 corrected simulators lie apart that differ by a millionth of a radian of steering, and no correction can be told to come closer. The gain is \
                 ring minus dot, its interval covers 95 % over drives; where it holds zero, these drives do not show that the correction helps.",
            );
        });
    });
}

/// Says in a sentence what came out.
fn said(diagnosis: &Diagnosis, closings: &[Closing]) -> String {
    let effects: Vec<String> = diagnosis.chosen.iter().map(|id| words::effect(id)).collect();
    let what = if effects.is_empty() {
        "No effect was added".to_owned()
    } else {
        format!("With {} added", words::list(&effects))
    };
    let Some(first) = closings.iter().find(|c| c.metric == "route_deviation").or(closings.first()) else {
        return format!("{what}: no drive could be compared.");
    };
    let (name, unit) = title(first);
    let [before, after] = [first.before, first.after].map(words::figure);
    let proven = match first.gain {
        Some(gain) if gain.low > 0.0 => "closer, its interval above zero",
        Some(gain) if gain.high < 0.0 => "farther, its interval below zero",
        Some(_) => "which these drives do not tell from no change",
        None => "one drive, hence no interval",
    };
    let near = if first.chance >= first.after { ", as near as chance lets one tell" } else { "" };
    format!("{what}: {name} {before} → {after} {unit} over {} drives ({proven}{near}).", first.drives)
}

fn title(closing: &Closing) -> (String, &'static str) {
    let unit = if closing.metric == "route_deviation" { "m" } else { "of 1" };
    (closing.metric.replace('_', " "), unit)
}

fn metric(m: &mut Markup, closing: &Closing) {
    let (name, unit) = title(closing);
    section(m, &words::capital(&name), |m| {
        let [before, after] = [closing.before, closing.after].map(words::figure);
        let gain = closing
            .gain
            .map_or(String::new(), |g| format!(" Gain {} to {} {unit}.", words::figure(g.low), words::figure(g.high)));
        let closed = words::share(closing.share_closed);
        let lead = format!(
            "Off by {before} → {after} {unit} in the mean of {} drives: {closed} closed.{gain} By chance {} {unit}.",
            closing.drives,
            words::figure(closing.chance)
        );
        m.leaf("p", &[("class", &"lead")], lead);
        picture(m, &name, unit, &closing.each);
        m.inside("details", &[], |m| {
            m.leaf("summary", &[], "Figures of each drive");
            let row = |d: &Drive| {
                vec![
                    d.scenario.clone(),
                    words::figure(d.before),
                    words::figure(d.after),
                    words::figure(d.before - d.after),
                    words::figure(d.chance),
                ]
            };
            let rows: Vec<Vec<String>> = closing.each.iter().map(row).collect();
            table(m, &name, &["scenario", "nominal", "corrected", "gain", "by chance"], &rows);
        });
    });
}

/// Draws each drive's way from the nominal to the corrected simulator; 0 is the real drive.
fn picture(m: &mut Markup, name: &str, unit: &str, drives: &[Drive]) {
    let most = drives.iter().flat_map(|d| [d.before, d.after, d.chance]).filter(|v| v.is_finite()).fold(1e-6, f64::max);
    let x = |value: f64| LEFT + (RIGHT - LEFT) * value / (1.05 * most);
    let height = TOP + ROW * drives.len() as f64 + 14.0;
    plot::wide(m, &format!("{name}, drive by drive"), height, |m| {
        let step = plot::round_above(most / 5.0);
        for k in 0..=5 {
            let at = step * f64::from(k);
            if at <= 1.05 * most {
                plot::line(m, if k == 0 { "zero" } else { "grid" }, (x(at), TOP - 8.0), (x(at), height - 8.0));
                plot::text(m, "tick", (x(at), TOP - 16.0), &words::plain(at));
            }
        }
        plot::text(m, "tick begin", (RIGHT + 14.0, TOP - 16.0), unit);
        for (k, drive) in drives.iter().enumerate() {
            let y = TOP + ROW * (k as f64 + 0.5);
            m.inside("g", &[("class", &"metric")], |m| {
                let told =
                    format!("{}: {} → {}", drive.scenario, words::figure(drive.before), words::figure(drive.after));
                m.leaf("title", &[], told);
                plot::text(m, "label", (LEFT - 16.0, y + 4.5), &plot::short(&drive.scenario, 30));
                plot::line(m, "chance", (x(0.0), y), (x(drive.chance), y));
                let class = if drive.after > drive.before { "way worse" } else { "way" };
                plot::line(m, class, (x(drive.before), y), (x(drive.after), y));
                plot::dot(m, "ring", (x(drive.before), y), 5.0);
                plot::dot(m, "dot", (x(drive.after), y), 5.0);
            });
        }
    });
}

#[cfg(test)]
mod tests {
    use ds_run_report::closing::{Columns, closings};

    #[test]
    fn the_page_says_what_came_closer_and_whether_it_is_proven() {
        let mut columns = Columns::default();
        for (scenario, before, after) in [("a <1>", 2.0, 0.5), ("b", 3.0, 1.0), ("c", 2.5, 0.7)] {
            columns.add("route_deviation", scenario, [before, after, 0.9]);
        }
        let mut diagnosis = crate::tests::clean();
        diagnosis.chosen = vec!["steer_delay".to_owned()];
        let page = crate::closing(&diagnosis, &closings(columns), &[("policy", "camera".to_owned())], "report.html");
        for needed in [
            "With steering delay added: route deviation 2.50 → 0.733 m over 3 drives (closer, its interval above zero, as near as chance lets one tell)",
            "By chance 0.9",
            "a &lt;1&gt;",
            "./report.html",
            "way",
            "camera",
        ] {
            assert!(page.contains(needed), "{needed} is not on the page: {page}");
        }
        assert!(crate::closing(&diagnosis, &[], &[], "report.html").contains("no drive could be compared"));
    }
}
