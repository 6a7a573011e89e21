//! Where policies attend to something else, laid over the frames: cells of the picture, or squares of the ground as the known camera
//! sees them.

use std::collections::BTreeMap;

use ds_page::level::{legend, level};
use ds_page::svg::{joined, picture, px};
use ds_page::{Markup, link};
use ds_policy::Grid;
use ds_policy::camera::eye::known_camera;

use crate::study::outcome::Attended;

/// Pixels of the page for one of the known camera's.
const TIMES: f64 = 2.5;

/// Writes one policy after the other.
pub(super) fn write(m: &mut Markup, attended: &BTreeMap<String, Vec<Attended>>) {
    if attended.is_empty() {
        return;
    }
    m.leaf("h2", &[], "Where in them");
    m.leaf(
        "p",
        &[],
        "What each policy attends to at each place, |c − c̃|² over its variance from one real frame to another: at 2 as far apart as \
         any two real frames. Left the real frame, right the source's, both as policies see them; of each source the scene that differs \
         most for the policy and the one in the middle, at the frame that differs most. Policies whose tokens are no places are not here.",
    );
    legend(m, "tenths of the variance", 0);
    for (policy, all) in attended {
        m.inside("details", &[], |m| {
            let ground = all.first().is_some_and(|one| one.ground);
            let places = if ground { "squares of the ground ahead" } else { "places of the picture" };
            m.leaf("summary", &[], format_args!("{policy}: {places}"));
            m.inside("div", &[("class", &"plots")], |m| all.iter().for_each(|one| overlay(m, one)));
        });
    }
}

fn overlay(m: &mut Markup, found: &Attended) {
    let lens = known_camera().intrinsics;
    let (width, height) = (TIMES * f64::from(lens.width_px), TIMES * f64::from(lens.height_px));
    let rank = if found.worst { "the farthest scene" } else { "the scene in the middle" };
    let title = format!("{}, {rank}: {}, {:.1}, frame {}", found.source, found.scenario, found.apart, found.frame);
    m.inside("figure", &[], |m| {
        picture(m, "over", &title, (2.0 * width, height), |m| {
            let (path, sides) = (link(&format!("scenes/{}", found.picture)), [px(2.0 * width), px(height)]);
            m.void("image", &[("href", &path), ("width", &sides[0]), ("height", &sides[1])]);
            // What of the ground lies beside the source's frame is cut off.
            m.inside("svg", &[("x", &px(width)), ("width", &px(width)), ("height", &px(height))], |m| {
                let grid = if found.ground { Grid::Ground(found.grid) } else { Grid::Picture(found.grid) };
                for (place, value) in found.places.iter().enumerate() {
                    let corners = grid.corners(place).map(|corner| (TIMES * corner.x, TIMES * corner.y));
                    let class = level(10.0 * value);
                    m.inside("polygon", &[("class", &class), ("points", &joined(&corners))], |m| {
                        m.leaf("title", &[], format_args!("{value:.2}"));
                    });
                }
            });
        });
        m.leaf("figcaption", &[], &title);
    });
}
