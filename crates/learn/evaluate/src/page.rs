//! The page of an evaluation: pictures first, then plots and tables with intervals, in one file beside the videos.

mod brief;
pub(crate) mod plot;
pub(crate) mod table;

use std::collections::BTreeMap;

use ds_page::{Document, Markup, Pictures, link};

use crate::config::EvalConfig;
use crate::estimate::Estimate;
use crate::film::STILLS;
use crate::outcome::{
    ArmDrift, ArmLayout, ColumnLayout, FIRST_FRAMES_SHEET, LookFigures, Outcome, Sharpness, WordedOutcome,
};
use ds_train::colour::Colour;
use plot::{Line, Plot};
use table::{shown, table};

const STYLE: &str = include_str!("page/page.css");

/// Returns the page.
#[must_use]
pub(crate) fn html(outcome: &Outcome, config: &EvalConfig) -> String {
    let document =
        Document { title: "Frames of the video model", style: STYLE, script: None, pictures: Pictures::Beside };
    document.page(|m| m.inside("main", &[], |m| body(m, outcome, config)))
}

fn body(m: &mut Markup, outcome: &Outcome, config: &EvalConfig) {
    m.leaf("h1", &[], "Frames of the video model");
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Held-out scenarios; every figure stands with its 90 % interval over scenarios drawn with replacement.",
    );
    if outcome.quick {
        m.leaf("p", &[("class", &"warn")], "A quick look: too few scenarios for a judgement.");
    }
    pictures(m, outcome, config);
    brief::write(m, outcome);
    sharpness(m, outcome);
    layout(m, outcome);
    drift(m, outcome);
    appearance(m, outcome);
    first_frames(m, outcome);
    speed(m, outcome);
    arms(m, outcome);
}

fn arms(m: &mut Markup, outcome: &Outcome) {
    let row = |(name, arm): (&String, &crate::outcome::ArmNote)| {
        vec![name.clone(), arm.kind.clone(), arm.digest[..arm.digest.len().min(12)].to_owned(), arm.remark.clone()]
    };
    m.leaf("h2", &[], "Arms");
    table(m, &["arm", "frames are made as", "weights", "remark"], &outcome.arms.iter().map(row).collect::<Vec<_>>());
}

fn sharpness(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.sharpness else { return };
    m.leaf("h2", &[], "Sharpness");
    let (first, last, every) = part.frames;
    m.leaf(
        "p",
        &[],
        format_args!(
            "Frames {first} to {last} of whole drives, every {every}. Detail: mean absolute Laplacian over that of the \
             world's own frames. Blocks: steps at the borders of 8×8 pixels over those inside, beside those of the world's \
             own frames. Seam: change between chunks over that within. Distance beside the road: perceptual, from the world's own \
             frames 45 to 55, where they show neither road nor road users nor sky."
        ),
    );
    for (name, column) in &part.columns {
        m.leaf("h3", &[], format_args!("Column {name}"));
        let row = |(arm, found): (&String, &Sharpness)| {
            vec![
                arm.clone(),
                shown(found.laplacian_ratio, 2),
                shown(found.border_ratio, 2),
                shown(found.reference_border_ratio, 2),
                shown(found.seam, 2),
                shown(found.psnr_db, 1),
                shown(found.off_road_distance, 3),
            ]
        };
        let head =
            ["arm", "detail", "blocks", "blocks of the world's own", "seam", "PSNR dB", "distance beside the road"];
        table(m, &head, &column.iter().map(row).collect::<Vec<_>>());
        if let Some(gain) = part.structures_gain.get(name) {
            let gain = shown(Some(*gain), 2);
            m.leaf(
                "p",
                &[],
                format_args!("Share of the distance beside the road that goes with structures in the layout: {gain}."),
            );
        }
    }
}

fn layout(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.layout else { return };
    m.leaf("h2", &[], "Layout, fidelity, colour, seams");
    let (starts, frames, first, every) = &part.clips;
    m.leaf(
        "p",
        &[],
        format_args!(
            "Clips of {frames} frames from ticks {starts:?}; every {every} frames from {first} on are looked at. A traffic \
             light is lower than two pixels beyond {:.0} m.",
            part.two_pixels_m
        ),
    );
    for (name, column) in &part.columns {
        m.leaf("h3", &[], format_args!("Column {name}"));
        iou(m, column);
        fidelity(m, column);
        lights(m, column);
        let made = column.comparisons.iter().filter(|(_, found)| found.is_some());
        let rows: Vec<Vec<String>> = made.map(|(name, e)| vec![name.replace('_', " "), shown(*e, 3)]).collect();
        if !rows.is_empty() {
            table(m, &["over the same scenarios", "value"], &rows);
        }
    }
}

/// Lists the world's own frames and then all arms.
fn all(column: &ColumnLayout) -> impl Iterator<Item = (&str, &ArmLayout)> {
    let own = std::iter::once(("reference frames", &column.reference));
    own.chain(column.arms.iter().map(|(name, arm)| (name.as_str(), arm)))
}

fn iou(m: &mut Markup, column: &ColumnLayout) {
    let targets: Vec<&String> = column.reference.iou.keys().collect();
    let mut head = vec!["IoU", "frames"];
    head.extend(targets.iter().map(|target| target.as_str()));
    head.push("layout error");
    let row = |(name, arm): (&str, &ArmLayout)| {
        let mut row = vec![name.to_owned(), arm.frames.to_string()];
        row.extend(targets.iter().map(|target| shown(arm.iou.get(*target).copied().flatten(), 3)));
        row.push(shown(arm.error, 3));
        row
    };
    table(m, &head, &all(column).map(row).collect::<Vec<_>>());
}

fn fidelity(m: &mut Markup, column: &ColumnLayout) {
    let mut head = vec!["frames", "PSNR dB", "perceptual distance", "Fréchet distance", "seam"];
    head.extend(Colour::NAMES);
    let row = |(name, arm): (&str, &ArmLayout)| {
        let mut row = vec![name.to_owned(), shown(arm.psnr_db, 2), shown(arm.distance, 4), shown(arm.frechet, 2)];
        row.push(shown(arm.seam, 2));
        row.extend(Colour::NAMES.iter().map(|name| shown(arm.colour.get(*name).copied().flatten(), 1)));
        row
    };
    table(m, &head, &all(column).map(row).collect::<Vec<_>>());
}

fn lights(m: &mut Markup, column: &ColumnLayout) {
    if column.reference.lights.iter().all(|bin| bin.seen == 0) {
        m.leaf("p", &[], "No traffic light was seen.");
        return;
    }
    let bins: Vec<String> =
        column.reference.lights.iter().map(|bin| format!("{:.0} to {:.0} m", bin.from_m, bin.to_m)).collect();
    let mut head = vec!["traffic lights read right"];
    head.extend(bins.iter().map(String::as_str));
    let row = |(name, arm): (&str, &ArmLayout)| {
        let mut row = vec![name.to_owned()];
        row.extend(arm.lights.iter().map(|bin| format!("{} of {}", shown(bin.accuracy, 2), bin.seen)));
        row
    };
    table(m, &head, &all(column).map(row).collect::<Vec<_>>());
}

fn drift(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.drift else { return };
    m.leaf("h2", &[], "Drift");
    m.leaf(
        "p",
        &[],
        format_args!(
            "Fréchet distance of the features of {} frames up to each mark from those of the world's own frames of the same \
             moments; {} ticks of the log per frame.",
            part.window, part.pace
        ),
    );
    for (name, column) in &part.columns {
        m.leaf("h3", &[], format_args!("Column {name}"));
        let lines: Vec<Line> = column.arms.iter().map(|(arm, found)| Line::of(arm, &found.curve)).collect();
        Plot { title: "Fréchet distance by frame", lines: &lines }.draw(m);
        let mut rows: Vec<Vec<String>> = column.arms.iter().map(|(arm, found)| drift_row(arm, found)).collect();
        rows.push(vec!["rise of clean minus early".to_owned(), shown(column.difference, 2)]);
        rows.push(vec!["1 − early over clean".to_owned(), shown(column.reduction, 2)]);
        table(m, &["arm", "rise to the last mark", "long run, per 100 frames"], &rows);
        colour_plots(m, &column.arms);
    }
}

fn drift_row(arm: &str, found: &ArmDrift) -> Vec<String> {
    let mut row = vec![arm.to_owned(), shown(found.rise, 2)];
    if let Some(long) = &found.long {
        let slope = |name: &str| shown(long.colour_slopes.get(name).copied().flatten(), 2);
        row.push(format!(
            "frames {} to {}: features {}, luma {}, contrast {}, detail {}; contrast kept {}",
            long.frames.1,
            long.frames.0,
            shown(long.feature_slope, 2),
            slope("luma"),
            slope("contrast"),
            slope("detail"),
            shown(long.contrast_kept, 2),
        ));
    }
    row
}

fn colour_plots(m: &mut Markup, arms: &BTreeMap<String, ArmDrift>) {
    m.inside("div", &[("class", &"plots")], |m| {
        for name in Colour::NAMES {
            let lines: Vec<Line> = arms
                .iter()
                .filter_map(|(arm, found)| found.colour.get(name).map(|points| Line::of(arm, points)))
                .collect();
            let title = format!("{name}: difference from the world's own frames");
            Plot { title: &title, lines: &lines }.draw(m);
        }
    });
}

fn appearance(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.appearance else { return };
    m.leaf("h2", &[], format_args!("Look kept at frame {}", part.at));
    m.leaf("p", &[], "Share of frames whose look is still named right.");
    for (name, column) in &part.columns {
        m.leaf("h3", &[], format_args!("Column {name}"));
        let arms: Vec<&String> = column.values().flat_map(|found| found.arms.keys()).collect();
        let arms: std::collections::BTreeSet<&String> = arms.into_iter().collect();
        let mut head = vec!["condition", "reference frames"];
        head.extend(arms.iter().map(|arm| arm.as_str()));
        head.extend(["with minus without", "named"]);
        let row = |(condition, found): (&String, &crate::outcome::ConditionOutcome)| {
            let mut row = vec![condition.clone(), shown(found.reference, 2)];
            row.extend(arms.iter().map(|arm| shown(found.arms.get(*arm).copied().flatten(), 2)));
            row.push(shown(found.gain, 2));
            row.push(taken_for(&found.named));
            row
        };
        table(m, &head, &column.iter().map(row).collect::<Vec<_>>());
    }
}

/// Says of each arm what its frames are named, the most frequent first.
fn taken_for(named: &BTreeMap<String, BTreeMap<String, f64>>) -> String {
    let arm = |(arm, shares): (&String, &BTreeMap<String, f64>)| {
        let mut shares: Vec<_> = shares.iter().collect();
        shares.sort_by(|a, b| b.1.total_cmp(a.1));
        let shares: Vec<String> = shares.iter().map(|(name, share)| format!("{name} {share:.2}")).collect();
        format!("{arm}: {}", shares.join(", "))
    };
    named.iter().map(arm).collect::<Vec<_>>().join("; ")
}

fn first_frames(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.first_frames else { return };
    m.leaf("h2", &[], "First frames from layout and words");
    let rows: Vec<&str> = part.conditions.keys().map(String::as_str).collect();
    m.leaf(
        "p",
        &[],
        format_args!("From top to bottom: {}; in pairs, the frame from words and the world's own.", rows.join(", ")),
    );
    m.inside("figure", &[], |m| {
        m.void("img", &[("src", &link(FIRST_FRAMES_SHEET)), ("alt", &FIRST_FRAMES_SHEET), ("loading", &"lazy")]);
    });
    let told = format!(
        "Of all frames the look of {} is named right. Luma, luma of the road, contrast and detail are over those of ordinary daylight; the world's own behind a stroke.",
        shown(part.recognised, 2)
    );
    m.leaf("p", &[], told);
    let row = |(condition, found): (&String, &WordedOutcome)| {
        let pair = |of: fn(&LookFigures) -> Option<Estimate>| {
            format!("{} / {}", shown(of(&found.words), 2), shown(of(&found.own), 2))
        };
        vec![
            condition.clone(),
            pair(|shown| shown.recognised),
            pair(|shown| shown.luma),
            pair(|shown| shown.ground),
            pair(|shown| shown.contrast),
            pair(|shown| shown.detail),
        ]
    };
    let head = ["condition", "named right", "luma", "road", "contrast", "detail"];
    table(m, &head, &part.conditions.iter().map(row).collect::<Vec<_>>());
}

fn speed(m: &mut Markup, outcome: &Outcome) {
    let Some(part) = &outcome.speed else { return };
    m.leaf("h2", &[], "Speed");
    let row = vec![
        part.preset.clone(),
        part.threads.to_string(),
        shown(part.frames_per_second, 1),
        shown(part.transformer_gflops, 0),
        shown(part.gemm_gflops, 0),
        shown(part.gemm_share, 2),
    ];
    let head = ["preset", "threads", "frames a second", "transformer, GFLOP/s", "matrix products, GFLOP/s", "share"];
    table(m, &head, &[row]);
}

fn pictures(m: &mut Markup, outcome: &Outcome, config: &EvalConfig) {
    let Some(videos) = config.videos.as_ref().filter(|_| !outcome.videos.is_empty()) else { return };
    let stills: Vec<String> = STILLS.iter().filter(|at| **at <= videos.frames).map(u32::to_string).collect();
    let (stills, arms) = (stills.join(", "), videos.arms.join(", "));
    m.leaf(
        "p",
        &[],
        format_args!(
            "From left to right: the world's own frames, layouts, {arms}. Stills are of frames {stills}, from top to bottom; \
             the film is below them."
        ),
    );
    for name in &outcome.videos {
        m.inside("figure", &[], |m| {
            for file in [name.replace(".gif", ".png"), name.clone()] {
                let path = link(&format!("videos/{file}"));
                m.void("img", &[("src", &path), ("alt", &file), ("loading", &"lazy")]);
            }
            m.leaf("figcaption", &[], name.trim_end_matches(".gif"));
        });
    }
}

#[cfg(test)]
mod tests;
