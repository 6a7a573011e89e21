//! The page is well-formed, shows what there is and nothing else, fetches nothing, and lets no name out of its place.
//!
//! Every name of the sample is hostile; numbers that are none (NaN, infinite) are among its values.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_diagnosis::Verdict;
use ds_diagnosis::discovery::{Discovery, FoundLaw, FoundTerm, LawKind, LawShare, Place};
use ds_diagnosis::modulation::{Modulation, Session};
use ds_diagnosis::saved::Saved;
use ds_diagnosis::schema::{
    Cell, Corrected, CorrectedEffect, Diagnosis, Finding, Manoeuvre, Regime, Remainder, Shrink, Unknown,
};

use super::markup::escaped;
use super::{index, page, text, values};

#[path = "../../../base/page/tests/made/checked.rs"]
mod checked;
use checked::checked;

const HOSTILE: &str = "<script>alert(\"1\")</script>\u{202e}\u{1b}[31m&'";

fn finding(id: &str, probability: f64, value: f64, unit: &str) -> Finding {
    Finding {
        id: id.to_owned(),
        probability,
        value,
        unit: unit.to_owned(),
        interval90: [value - 0.01, value + 0.01],
        group: vec![id.to_owned()],
        heldout_gain: Some(12.0),
        evidence_gain: 30.0,
        params: BTreeMap::from([("value".to_owned(), value)]),
    }
}

fn cell(channel: &str, regime: Regime, effect_size: f64) -> Cell {
    Cell { channel: channel.to_owned(), regime, effect_size, q_value: Some(0.001), t: vec![[1.0, 4.0]] }
}

/// A metric of which calibration closes a tenth.
fn shrink(metric: &str, [before, after, floor]: [f64; 3], share: f64) -> Shrink {
    Shrink {
        metric: metric.to_owned(),
        before,
        nuisance: Some(before - 0.1 * (before - floor)),
        after,
        floor,
        share_nuisance: Some(0.1),
        share_explained: share.is_finite().then_some(share),
        interval90: share.is_finite().then_some([share - 0.1, share + 0.05]),
        saved: None,
        data: "heldout".to_owned(),
    }
}

/// A diagnosis with nothing in it.
fn empty() -> Diagnosis {
    Diagnosis { p_none: 0.97, p_unknown: 0.03, secs: 1.0, ..Diagnosis::blank("quiet") }
}

/// One effect, cleanly found.
pub(crate) fn clean() -> Diagnosis {
    let fast = Regime { drive: 1, steering: Some("fast".to_owned()), ..Regime::default() };
    Diagnosis {
        case: "delayed".to_owned(),
        verdict: Verdict::Single,
        effects: vec![finding("steer_delay", 0.91, 0.15, "s"), finding("steer_lag", 0.04, 0.08, "s")],
        p_none: 0.0,
        p_unknown: 0.05,
        chosen: vec!["steer_delay".to_owned()],
        cells: vec![cell("yaw_rate", Regime { drive: 1, ..Regime::default() }, 12.4), cell("dy", fast, 3.0)],
        how_far: vec![
            shrink("position_2s", [0.55, 0.06, 0.05], 0.98),
            shrink("channel:ax", [0.05, 0.05, 0.055], f64::NAN),
        ],
        predicted_share: Some(0.92),
        ..empty()
    }
}

/// Everything at once, with hostile names and numbers that are none.
fn hostile() -> Diagnosis {
    let mut first = finding(HOSTILE, f64::NAN, f64::INFINITY, HOSTILE);
    first.group.push("steer_lag".to_owned());
    let tile = Regime { tile: Some([2, 5]), ..Regime::default() };
    let far = Regime { tile: Some([90, 5]), ..Regime::default() };
    let odd = Regime { drive: 3, speed: Some(HOSTILE.to_owned()), ..Regime::default() };
    Diagnosis {
        case: HOSTILE.to_owned(),
        verdict: Verdict::Unknown,
        effects: vec![first, finding("mu", 0.2, f64::NAN, "x"), finding("steer_rate", 0.2, 0.3, "rad/s")],
        chosen: vec![HOSTILE.to_owned()],
        indistinguishable: vec![vec![HOSTILE.to_owned(), "mu".to_owned()]],
        cells: vec![
            cell(HOSTILE, odd, f64::NAN),
            cell("dx", Regime::default(), f64::INFINITY),
            cell("camera", tile, 7.0),
            cell("camera", far, 9.0),
        ],
        how_far: vec![shrink(HOSTILE, [f64::NAN, 1.0, 0.0], f64::NAN), shrink("image_rmse", [9.0, 12.0, 3.0], -0.5)],
        predicted_share: None,
        unknown_description: Some(Remainder {
            channels: BTreeMap::from([(HOSTILE.to_owned(), f64::INFINITY), ("dx".to_owned(), 3.0)]),
            drives: vec![1],
            time_pattern: HOSTILE.to_owned(),
            frequency_hz: Some(f64::NAN),
            goes_with: Some((HOSTILE.to_owned(), 0.5)),
            nearest: vec![HOSTILE.to_owned()],
            text: HOSTILE.to_owned(),
        }),
        next_manoeuvre: vec![Manoeuvre {
            name: HOSTILE.to_owned(),
            separates: [HOSTILE.to_owned(), "mu".to_owned()],
            expected_log_bayes_factor: f64::NAN,
            secs_needed: f64::INFINITY,
        }],
        corrected_model: Corrected {
            laws: Vec::new(),
            effects: vec![CorrectedEffect { id: HOSTILE.to_owned(), value: 1.0, values: vec![f64::NAN] }],
            nuisance: BTreeMap::from([(HOSTILE.to_owned(), 0.1)]),
            ordinary: BTreeMap::from([(HOSTILE.to_owned(), 0.2)]),
        },
        floor_source: HOSTILE.to_owned(),
        warnings: vec![HOSTILE.to_owned()],
        secs: f64::NAN,
        ..empty()
    }
}

fn has(page: &str, section: &str) -> bool {
    page.contains(&format!("<section id=\"{section}\""))
}

fn data(folder: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/data").join(folder);
    if !folder.join("meta.json").exists() {
        eprintln!("skipped: no case at {}", folder.display());
        return None;
    }
    Some(folder)
}

fn law(text: &str, expression: &str) -> Discovery {
    let term = FoundTerm { expression: expression.to_owned(), coefficient: -0.0357, interval90: [-0.041, f64::NAN] };
    let found = FoundLaw {
        text: text.to_owned(),
        terms: vec![term],
        kind: LawKind::Expression,
        port: "steering.linkage".to_owned(),
        unit: "rad".to_owned(),
        equivalent: vec![text.to_owned()],
        stable: false,
    };
    Discovery {
        insertion: vec![Place { id: "steering".to_owned(), probability: 0.97 }],
        law: Some(found),
        share_explained: Some(LawShare {
            metric: "position_2s".to_owned(),
            value: 0.83,
            interval90: None,
            on: "heldout".to_owned(),
        }),
        p_none: 0.03,
        ..Discovery::default()
    }
}

#[test]
fn a_law_is_told_with_its_place_and_drawn_over_its_signal() {
    let text = "steering.linkage: -0.0357*delta[-0.07;0.05]*abs(ay[-2.7;2.3])";
    let found = Diagnosis {
        verdict: Verdict::Unknown,
        p_unknown: 0.95,
        discovery: Some(law(text, "delta*abs(ay)")),
        ..clean()
    };
    let page = page(&found, None);
    checked(&page);
    assert!(has(&page, "law") && page.contains("--law") && page.contains("class=\"whisker curve\""));
    assert!(page.contains("steering angle, rad"), "the signal along which it changes most");
    let said = super::text(&found);
    assert!(said.contains("u = −0.0357·delta·abs(ay) rad") && said.contains("83 %"), "{said}");
    // a table is drawn over the signal that it runs over, from its first knot to its last
    let text = "steering.linkage: 0.1*delta[-0.07;0.05]*hat(v;2;4;8) - 0.9*delta[-0.07;0.05]*hat(v;4;8;14)";
    let mut table = law(text, "delta*hat(v;2;4;8)");
    table.law.iter_mut().for_each(|law| law.kind = LawKind::Table);
    table.extrapolated_share = Some(0.4);
    let table = Diagnosis { verdict: Verdict::Unknown, p_unknown: 0.95, discovery: Some(table), ..clean() };
    let page = super::page(&table, None);
    checked(&page);
    assert!(
        page.contains("class=\"whisker curve\"")
            && page.contains("speed, m/s")
            && page.contains("40\u{a0}% of what it was measured on"),
        "{page}"
    );
    assert!(super::text(&table).contains("a table of 1 knots"), "{}", super::text(&table));
    assert!(super::text(&table).contains("over speed, m/s"), "{}", super::text(&table));
    // a text that is no law is shown and not drawn
    let hostile = Diagnosis { discovery: Some(law(HOSTILE, HOSTILE)), ..hostile() };
    let shown = super::page(&hostile, None);
    checked(&shown);
    assert!(!shown.contains("class=\"whisker curve\""));
    // of a law that another simulator cannot be given, what its own residuals say
    let mut inside = law("drive: -0.0357*v", "v");
    (inside.share_explained, inside.kept_gain, inside.note) = (None, Some(61.25), Some("not put in".to_owned()));
    let said = super::text(&Diagnosis { discovery: Some(inside), verdict: Verdict::Unknown, ..clean() });
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("kept from the fit its log score is 61.2 over that without it. Not put in."), "{said}");
    let none = Discovery { note: Some("no law holds".to_owned()), p_none: 1.0, ..Discovery::default() };
    let said = super::text(&Diagnosis { discovery: Some(none), ..clean() });
    assert!(said.contains("No law holds."), "{said}");
}

#[test]
fn an_onset_is_told() {
    let modulation = Modulation {
        effect: "steer_delay".to_owned(),
        kind: "onset".to_owned(),
        evidence: 41.3,
        onset_s: Some(18.5),
        interval90: Some([17.75, 19.25]),
        drive: Some(1),
        scope: Some("later".to_owned()),
        value: Some(0.15),
        sessions: vec![Session { drive: 1, size: 0.9, error: 0.1 }],
    };
    let onset = Diagnosis { modulation: Some(modulation.clone()), ..clean() };
    let html = page(&onset, None);
    assert!(html.contains("When it acts") && html.contains("18.5 s (90 %: 17.8 to 19.2 s) of drive 1"), "{html}");
    let told = text(&onset).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(told.contains("of drive 1, and stays in the drives after it"), "{told}");
    let constant = Modulation { kind: "constant".to_owned(), onset_s: None, ..modulation };
    assert!(!page(&Diagnosis { modulation: Some(constant), ..clean() }, None).contains("When it acts"));
}

#[test]
fn sections_are_there_when_their_data_is() {
    for (diagnosis, sections) in [
        (empty(), vec!["which", "where", "method"]),
        (clean(), vec!["which", "where", "shrink", "method"]),
        (hostile(), vec!["which", "unknown", "where", "shrink", "next", "method"]),
    ] {
        let page = page(&diagnosis, None);
        checked(&page);
        for section in ["which", "unknown", "where", "frames", "shrink", "time", "road", "next", "method"] {
            assert_eq!(has(&page, section), sections.contains(&section), "{section} of {}", diagnosis.case);
            assert_eq!(page.contains(&format!("href=\"#{section}\"")), sections.contains(&section));
        }
    }
    assert!(page(&empty(), None).contains("No cell lies significantly beyond the noise floor."));
}

#[test]
fn the_headline_says_it_all() {
    let said = |diagnosis: &Diagnosis| super::headline::sentence(diagnosis).replace(['\u{a0}', '\u{202f}'], " ");
    assert_eq!(
        said(&clean()),
        "The simulator leaves out steering delay (0.150 s), 91 % sure; corrected, it closes 98 % [88, 103] of the gap in \
         position after 2 s that calibration leaves on data kept from the fit."
    );
    let mut calibrated = clean();
    calibrated.how_far = vec![shrink("position_2s", [0.55, 0.06, 0.05], f64::NAN)];
    assert!(
        said(&calibrated).contains("but calibration leaves no gap in position after 2 s")
            && !page(&calibrated, None).contains("of the gap in position after 2 s that calibration leaves closed"),
        "what calibration closes is not told of the effect"
    );
    let mut earlier = clean();
    earlier.how_far[0].nuisance = None;
    assert!(said(&earlier).ends_with("of the gap in position after 2 s on data kept from the fit."));
    assert_eq!(said(&empty()), "Nothing is missing beyond what every vehicle and sensor has: 97 % sure.");
    let mut two = clean();
    two.verdict = Verdict::Multiple;
    two.chosen.push("steer_lag".to_owned());
    assert!(
        said(&two)
            .contains("leaves out two effects: steering delay (0.150 s) and steering lag (0.080 s), together 95 %")
    );
    let mut unknown = clean();
    unknown.verdict = Verdict::Unknown;
    assert!(said(&unknown).contains("The nearest is steering delay (0.150 s); the simulator with it closes 98 %"));
    unknown.chosen.clear();
    assert!(said(&unknown).ends_with("no effect of the library explains: 5 % sure."));
    unknown.unknown = Some(Unknown::new(0.05, 0.1));
    assert!(said(&unknown).contains("record three healthy drives or more"), "{}", said(&unknown));
    let mut rivals = clean();
    rivals.effects[0].group.push("pose_latency".to_owned());
    assert!(page(&rivals, None).contains("These data cannot tell steering delay from pose latency."));
    let mut worse = clean();
    worse.how_far = vec![shrink("position_2s", [0.5, 0.9, 0.05], -0.9)];
    assert!(
        said(&worse).ends_with("yet position after 2 s becomes worse when it is corrected on data kept from the fit.")
    );
    let mut wheel = clean();
    wheel.chosen = vec!["wheel_scale".to_owned()];
    wheel.effects = vec![finding("wheel_scale", 0.9, 0.97, "x")];
    wheel.how_far.push(shrink("channel:v_wheel", [0.5, 0.03, 0.02], 0.97));
    assert!(said(&wheel).contains("of the gap in wheel speed"), "an effect on one channel is judged by that channel");
}

/// Page and terminal, word by word.
fn both(diagnosis: &Diagnosis) -> [String; 2] {
    [page(diagnosis, None), text(diagnosis)]
        .map(|said| said.replace('\u{a0}', " ").split_whitespace().collect::<Vec<_>>().join(" "))
}

#[test]
fn page_terminal_and_file_tell_a_value_in_the_same_words() {
    let with = |whole: f64| {
        let effects = vec![CorrectedEffect { id: "steer_delay".to_owned(), value: whole, values: vec![whole] }];
        Diagnosis { corrected_model: Corrected { effects, ..Corrected::default() }, ..clean() }
    };
    let [number, split] = ["0.150 s [0.140, 0.160]", "beyond what is usual of the vehicle, 0.162 s with it"];
    let apart = with(0.162);
    assert_eq!(values(&apart), [format!("steer_delay: {number} {split}")]);
    for (said, times) in both(&apart).iter().zip([3, 2]) {
        // the headline, the tile and the row of the page, the headline and the row of the terminal
        assert_eq!(said.matches(split).count(), times, "{said}");
        assert!(said.contains(&format!("(0.150 s {split})")) && said.contains("[0.140, 0.160]"), "{said}");
    }
    assert!(both(&apart)[1].contains(&values(&apart)[0]), "the terminal says the line of the file");
    let same = with(0.1502);
    assert_eq!(values(&same), [format!("steer_delay: {number}")]);
    for said in both(&same) {
        assert!(said.contains("(0.150 s)") && !said.contains("beyond what is usual"), "{said}");
    }
    assert!(values(&hostile()).is_empty() && values(&empty()).is_empty());
}

#[test]
fn what_is_saved_has_its_interval_or_says_why_not() {
    let saved = |interval90, drives, note: Option<&str>| {
        let mut found = clean();
        found.how_far[0].saved = Some(Saved { value: 0.438, interval90, drives, note: note.map(str::to_owned) });
        found
    };
    let note = "2 drives are too few for an interval, 5 are needed";
    for (diagnosis, words) in [
        (
            saved(Some([0.31, 0.52]), 8, None),
            "What was added saves 0.44 m in position after 2 s [0.31, 0.52], a 90 % interval over 8 drives.",
        ),
        (
            saved(None, 2, Some(note)),
            "What was added saves 0.438 m in position after 2 s; 2 drives are too few for an interval, 5 are needed.",
        ),
    ] {
        for said in both(&diagnosis) {
            assert!(said.contains(words), "{said}");
        }
    }
    assert!(both(&clean()).iter().all(|said| !said.contains("What was added saves")));
}

#[test]
fn names_cannot_run_or_fetch_anything() {
    for page in [page(&hostile(), None), index(&[("javascript:alert(1)".to_owned(), hostile())])] {
        let tags = checked(&page);
        assert!(page.contains(&escaped("<script>alert(\"1\")</script>")), "the name is shown");
        assert!(!page.contains("<script>alert") && !page.contains("alert(\"1\")"));
        assert_eq!(tags.iter().filter(|tag| *tag == "script").count(), 2, "one script opens and closes");
        assert!(!tags.iter().any(|tag| ["iframe", "link", "object", "base"].contains(&tag.as_str())));
        for outside in ["http://", "https://", "url(", "@import", "href=\"javascript", "\u{202e}", "\u{1b}"] {
            assert!(!page.contains(outside), "{outside:?} on the page");
        }
        for target in page.split("src=\"").skip(1).chain(page.split("href=\"").skip(1)) {
            let known = ["data:image/jpeg;base64,", "#", "./"].iter().any(|start| target.starts_with(start));
            assert!(known, "{:?}", &target[..target.len().min(40)]);
        }
        assert!(!page.contains(">NaN") && !page.contains(">inf"), "a number that is none is a dash");
    }
}

#[test]
fn the_index_links_every_case() {
    let cases = [("a/page.html".to_owned(), clean()), ("b c/page.html".to_owned(), empty())];
    let page = index(&cases);
    let tags = checked(&page);
    assert_eq!(tags.iter().filter(|tag| *tag == "tr").count(), 2 * 3, "a heading and two cases");
    for part in
        ["href=\"./a/page.html\"", "href=\"./b%20c/page.html\"", "steering delay", "one effect", "nothing missing"]
    {
        assert!(page.contains(part), "{part:?} is missing");
    }
    checked(&index(&[]));
}

#[test]
fn text_says_the_same_in_bounded_lines() {
    let said = text(&clean());
    for part in ["delayed", "91 %", "steering delay", "yaw rate, drive 1: 12 × floor", "no gap", "92 %", "10 %"] {
        assert!(said.contains(part), "{part:?} is missing in\n{said}");
    }
    for said in [said, text(&hostile()), text(&empty())] {
        assert!(!said.contains(['\u{1b}', '\u{202e}']), "no log drives the terminal");
        assert!(!said.contains("NaN") && !said.contains("inf "), "{said}");
    }
    assert!(text(&clean()).lines().all(|line| line.chars().count() <= 100));
}

#[test]
fn a_case_that_cannot_be_read_is_named() {
    let page = page(&clean(), Some(Path::new("/nowhere")));
    checked(&page);
    assert!(page.contains("without drive plots") && !has(&page, "time"));
}

#[test]
fn a_case_of_logs_adds_time_and_road() {
    let Some(folder) = data("gap-practice/case_04") else { return };
    let page = page(&clean(), Some(&folder));
    checked(&page);
    assert!(has(&page, "time") && has(&page, "road") && !has(&page, "frames"));
    assert!(page.contains("Drive 3") && page.contains("kept from the fit"));
    assert!(page.matches("data-t=").count() > 200, "the road is coloured piece by piece");
}

#[test]
fn channels_that_were_not_recorded_are_not_called_clean() {
    let Some(folder) = data("gap-practice/case_04") else { return };
    let copy = tempfile::tempdir().expect("a folder");
    for name in ["meta.json", "drive_0.csv", "drive_1.csv", "drive_2.csv", "drive_3.csv"] {
        let text = std::fs::read_to_string(folder.join(name)).expect("a file");
        // without the heads of their columns, position and lateral acceleration are absent
        let text = text.replacen(",x,y,", ",_x,_y,", 1).replacen(",ay,", ",_ay,", 1);
        std::fs::write(copy.path().join(name), text).expect("written");
    }
    let bare = page(&clean(), Some(copy.path()));
    checked(&bare);
    assert!(has(&bare, "time") && !has(&bare, "road"), "no map without a position");
    // along, across (which has a cell in the sample) and lateral acceleration
    assert_eq!(bare.matches("not recorded").count(), 2);
    assert_eq!(page(&clean(), Some(&folder)).matches("not recorded").count(), 0);
}

#[test]
fn a_case_of_frames_adds_tiles() {
    let Some(folder) = data("gap-camera-practice/case_03") else { return };
    let mut diagnosis = clean();
    diagnosis.cells = vec![cell("camera", Regime { tile: Some([2, 5]), ..Regime::default() }, 6.0)];
    let page = page(&diagnosis, Some(&folder));
    checked(&page);
    assert!(has(&page, "frames") && !has(&page, "time"));
    assert_eq!(page.matches("src=\"data:image/jpeg;base64,").count(), 6, "a frame and a tile, three pictures each");
    assert!(page.contains("Tile row 2, column 5"));
    assert!(page.len() < 400_000, "{} bytes", page.len());
}
