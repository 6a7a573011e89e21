//! How near the frames are for policies: scene by scene, and where in the picture a policy attends to something else.

use ds_diagnosis::attended::{Attended, Difference};

use super::markup::Markup;
use super::plot;
use super::words;

/// Scenes that are listed, the farthest.
const LISTED: usize = 8;
/// Size of a place, px, and what lies between two maps.
const PLACE: (f64, f64) = (30.0, 22.0);
const APART: f64 = 40.0;
const TOP: f64 = 22.0;

/// Writes one policy after the other.
pub(crate) fn section(m: &mut Markup, attended: &[Attended]) {
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Squared difference of what a policy attends to on the simulated and on the real frame of one state, over its variance \
         from one real frame to another: at 2 they are as far apart as any two real frames, near 0 the policy sees the same.",
    );
    for seen in attended {
        m.leaf("h3", &[], &seen.policy);
        scenes(m, &seen.scenes);
        if let Some(grid) = seen.grid.filter(|[rows, columns]| rows * columns == seen.places.len()) {
            plot::level_legend(m, "tenths of the variance", 0);
            places(m, grid, seen.ground, &seen.places);
        }
    }
}

fn scenes(m: &mut Markup, scenes: &[Difference]) {
    m.inside("table", &[], |m| {
        m.inside("tr", &[], |m| {
            ["scene", "as it is", "with the effects"].iter().for_each(|head| m.leaf("th", &[], head));
        });
        for scene in scenes.iter().take(LISTED) {
            m.inside("tr", &[], |m| {
                m.leaf("td", &[], scene.scene.as_deref().unwrap_or(""));
                [scene.before, scene.after].iter().for_each(|value| m.leaf("td", &[], words::fixed(*value, 3)));
            });
        }
    });
    if scenes.len() > LISTED {
        m.leaf("p", &[("class", &"note")], format_args!("The farthest {LISTED} of {} scenes.", scenes.len()));
    }
}

/// Two maps of the picture, or of the ground from above: as it is, and with the effects.
fn places(m: &mut Markup, [rows, columns]: [usize; 2], ground: bool, places: &[Difference]) {
    let wide = columns as f64 * PLACE.0;
    let view = (2.0 * wide + APART, TOP + rows as f64 * PLACE.1);
    let (title, seen) = if ground {
        ("Where on the ground before the car the policy attends to something else", ", the ground ahead, from above")
    } else {
        ("Where in the picture the policy attends to something else", "")
    };
    plot::picture(m, "plot tilemap", title, view, |m| {
        for (left, name, after) in [(0.0, "as it is", false), (wide + APART, "with the effects", true)] {
            plot::text(m, "tick begin", (left, 14.0), &format!("{name}{seen}"));
            for (index, place) in places.iter().enumerate() {
                let (row, column) = (index / columns, index % columns);
                let at = (left + column as f64 * PLACE.0, TOP + row as f64 * PLACE.1);
                let value = if after { place.after } else { place.before };
                let words = format!("row {row}, column {column}: {}", words::fixed(value, 2));
                plot::area(m, plot::level(10.0 * value), at, (PLACE.0 - 2.0, PLACE.1 - 2.0), &words);
            }
        }
    });
}
