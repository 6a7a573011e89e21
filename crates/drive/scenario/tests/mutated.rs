//! Mutated scenario files: each is refused by name or gives a scene that can be written again.

use std::path::Path;
use std::sync::LazyLock;

use ds_scenario::store::to_text;
use ds_scenario::{Family, generate, parse};

static WHOLE: LazyLock<String> =
    LazyLock::new(|| to_text(&generate(Family::SignalisedCrossing, 1), Path::new("x")).expect("a valid scene"));

#[test]
fn mutated_scenarios_are_refused_or_read() {
    crate::mutation::all_are_borne("mutated::mutated_scenarios_are_refused_or_read", |index| {
        let path = Path::new("mutated.scenario.json");
        if let Ok((scene, _warnings)) = parse(&crate::mutation::text(&WHOLE, "scenario", index), path) {
            to_text(&scene, path).expect("what was read can be written");
        }
    });
}
