//! Writes the shipped scenarios anew: `cargo run -p ds-scenario --example ship`, from the root of the repository.
//!
//! A test compares the shipped files with what the generator makes.

use std::path::Path;

use ds_scenario::{ScenarioError, family, save};

fn main() -> Result<(), ScenarioError> {
    let folder = Path::new("scenarios");
    for (family, seed) in family::SHIPPED {
        save(&family::shipped(family, seed), &folder.join(format!("base/{family}.scenario.json")))?;
    }
    save(&family::tiny(), &folder.join("tiny/straight.scenario.json"))
}
