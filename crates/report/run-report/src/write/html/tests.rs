//! The page is well-formed, holds every scenario, fetches nothing, and lets no name out of its place.
//!
//! Every name of the sample is hostile to at least one of the places that it is written to.

use super::markup::escaped;
use super::*;
use crate::sample::{self, HOSTILE};

#[path = "../../../../../base/page/tests/made/checked.rs"]
mod checked;
use checked::checked;

fn sample_page() -> (Vec<Results>, String) {
    let runs = sample::runs();
    let mut pictures = Vec::new();
    for (run, results) in runs.iter().enumerate() {
        pictures.extend(results.episodes.iter().enumerate().map(|(episode, entry)| {
            let hostile = entry.scenario == HOSTILE;
            let path = if hostile { format!("javascript:{HOSTILE}") } else { format!("pictures/{run}-{episode}.gif") };
            Picture { run, episode, path }
        }));
    }
    let page = page(&sample::report(), &runs, &pictures);
    (runs, page)
}

#[test]
fn the_page_is_well_formed_and_complete() {
    let (runs, page) = sample_page();
    let tags = checked(&page);
    for tag in ["h1", "caption", "svg", "title", "img", "button", "nav", "dl"] {
        assert!(tags.iter().any(|met| met == tag), "no <{tag}>");
    }
    for episode in runs.iter().flat_map(|run| &run.episodes) {
        let name = format!("<bdi>{}</bdi>", escaped(&episode.scenario));
        assert!(page.contains(&name), "{:?} is not on the page", episode.scenario);
        assert!(page.contains(&escaped(&episode.reason)));
    }
    for part in
        [crate::aggregate::WEIGHTING, "bridgesim 1", "Scorer bias", "Proposal coverage", "at tick 41", "only-here"]
    {
        assert!(page.contains(part), "{part:?} is missing");
    }
}

#[test]
fn names_cannot_run_or_fetch_anything() {
    let (_, page) = sample_page();
    let tags = checked(&page);
    assert_eq!(tags.iter().filter(|tag| *tag == "script").count(), 2, "one script opens and closes");
    assert!(!tags.iter().any(|tag| ["iframe", "link", "object", "base"].contains(&tag.as_str())));
    assert!(!page.contains("<img src=//x") && !page.contains("alert(\"1\")"));
    assert!(!page.contains("http://") && !page.contains("https://") && !page.contains("href=\"javascript"));
    assert!(!page.contains('\u{202e}'), "names may not turn the direction of writing");
    for target in page.split("src=\"").skip(1).chain(page.split("href=\"").skip(1)) {
        assert!(target.starts_with("./") || target.starts_with('#'), "{:?}", &target[..target.len().min(40)]);
    }
}

#[test]
fn pictures_have_words() {
    let (_, page) = sample_page();
    let images: Vec<&str> = page.split("<img ").skip(1).collect();
    assert!(images.len() > 4 && images.iter().all(|image| image.contains("alt=\"lattice drives ")));
    assert!(images.iter().any(|image| image.starts_with("src=\"./javascript%3A")), "the hostile one is a file name");
    assert!(images.iter().any(|image| image.starts_with("src=\"./pictures/0-")));
}

#[test]
fn an_empty_report_is_a_page_too() {
    let report = Report::new(&[], Vec::new(), &crate::report::ReportOptions::default());
    checked(&page(&report, &[], &[]));
}
