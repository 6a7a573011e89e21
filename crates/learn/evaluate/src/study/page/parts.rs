//! The page of study `parts`: which part of a frame makes a policy plan otherwise, by source and policy, and the moments at which
//! plans are furthest apart.

use ds_page::Markup;
use ds_page::svg::{area, line, text, wide};

use super::{looks, scene, shown, title};
use crate::page::table::table;
use crate::study::outcome::{Figure, FurthestApart, Outcome, PartOf, Parts, PlansOf};

/// Writes the page below its head.
pub(super) fn body(m: &mut Markup, outcome: &Outcome, found: &Parts) {
    m.leaf("h1", &[], title(&outcome.study));
    m.leaf(
        "p",
        &[("class", &"lead")],
        format_args!(
            "{}; half of them beside the log. At each moment a policy plans on the reference \
             camera's frame and on the source's; two plans are as far apart as the places that they reach after 2 s. The \
             reference is the camera of the project's own world {}: figures are {}, not sim-to-real. 95 % intervals over \
             scenarios, the same draws for all.",
            outcome.of_scenarios(), outcome.world, outcome.kind
        ),
    );
    if outcome.quick {
        m.leaf("p", &[("class", &"warn")], "A quick look: too few scenarios for a judgement.");
    }
    looks(m, &outcome.looks);
    m.leaf(
        "p",
        &[],
        "Taken away: how much nearer the plan comes to that on the reference once the source's frame has the reference's pixels \
         of the part; below zero it goes further away. Alone: how far the plan on the reference's frame goes away once it has \
         the source's pixels of the part. Parts are told from the layout, people, vehicles and cones with a border of one \
         pixel. They act together, so neither column adds up to the whole.",
    );
    for (source, policies) in &found.sources {
        m.leaf("h2", &[], source);
        for (policy, plans) in policies {
            of_policy(m, policy, plans);
        }
        if let Some(furthest) = found.furthest.get(source) {
            apart(m, furthest);
        }
    }
}

fn of_policy(m: &mut Markup, policy: &str, plans: &PlansOf) {
    m.leaf("h3", &[], policy);
    m.leaf(
        "p",
        &[],
        format_args!(
            "Plans at {} moments are {} m apart; those on the source reach {} m further ahead.",
            plans.moments,
            shown(plans.apart_m),
            shown(plans.ahead_m)
        ),
    );
    bars(m, policy, plans);
    let row = |part: &PartOf| {
        vec![
            part.part.clone(),
            shown(part.taken_away_m),
            shown(part.alone_m),
            format!("{:.2} [{:.2}, {:.2}]", 100.0 * part.share.value, 100.0 * part.share.low, 100.0 * part.share.high),
        ]
    };
    let head = ["part", "taken away, m", "alone, m", "pixels, %"];
    table(m, &head, &plans.parts.iter().map(row).collect::<Vec<_>>());
}

/// Two bars a part, what it takes away above what it does alone, with their intervals.
fn bars(m: &mut Markup, policy: &str, plans: &PlansOf) {
    let figures = || plans.parts.iter().flat_map(|part| [part.taken_away_m, part.alone_m]);
    let most = figures().map(|figure| figure.high.max(figure.value)).fold(1e-9, f64::max);
    let least = figures().map(|figure| figure.low.min(figure.value)).fold(0.0, f64::min);
    let x = |value: f64| 150.0 + 420.0 * (value - least) / (most - least);
    let height = 40.0 + 30.0 * plans.parts.len() as f64;
    wide(m, &format!("Parts to {policy}"), (640.0, height), |m| {
        text(m, "title", (8.0, 16.0), "metres: taken away above, alone below");
        for (row, part) in plans.parts.iter().enumerate() {
            let y = 26.0 + 30.0 * row as f64;
            text(m, "", (8.0, y + 15.0), &part.part);
            let bar = |m: &mut Markup, class: &str, y: f64, figure: Figure| {
                let (from, to) = (x(figure.value.min(0.0)), x(figure.value.max(0.0)));
                area(m, class, (from, y), (to - from, 10.0), &shown(figure));
                line(m, "l3", (x(figure.low), y + 5.0), (x(figure.high), y + 5.0));
            };
            bar(m, "b0", y, part.taken_away_m);
            bar(m, "b1", y + 12.0, part.alone_m);
            text(m, "", (x(most) + 8.0, y + 9.0), &format!("{:.2}", part.taken_away_m.value));
            text(m, "", (x(most) + 8.0, y + 21.0), &format!("{:.2}", part.alone_m.value));
        }
        line(m, "axis", (x(0.0), 22.0), (x(0.0), height - 12.0));
    });
}

fn apart(m: &mut Markup, furthest: &[FurthestApart]) {
    m.leaf("h3", &[], "Furthest apart");
    m.leaf(
        "p",
        &[],
        "Above the reference's frame, then the source's, below the layout. Means over the policies; the part that takes most \
         away stands last.",
    );
    m.inside("div", &[("class", &"plots")], |m| {
        for moment in furthest {
            let most = moment.taken_away_m.iter().max_by(|a, b| a.1.total_cmp(b.1));
            let most = most.map_or_else(String::new, |(part, taken)| format!("; {taken:.2} m less by {part}"));
            let caption = format_args!(
                "{}, frame {}: {:.2} m apart, {:+.2} m ahead{most}",
                moment.scenario, moment.frame, moment.apart_m, moment.ahead_m
            );
            scene(m, &moment.picture, &moment.picture, caption);
        }
    });
}
