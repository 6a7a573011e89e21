//! Sizes of the labelled effects of a world's cases in floor units, as JSON by case: of each case with one effect the largest
//! root mean square of what it changes in a channel over a drive, nothing where it changes no mean.
#![expect(clippy::print_stdout, reason = "the table is this example's answer")]

use std::collections::BTreeMap;
use std::path::Path;

use ds_diagnosis::json;
use ds_dynamics::case::Case;
use ds_dynamics::size::effect_size;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("a folder of cases with labels.json")?;
    let folder = Path::new(&folder);
    let labels: BTreeMap<String, serde_json::Value> = json::read(&folder.join("labels.json"))?;
    let mut sizes = BTreeMap::new();
    for (name, label) in labels.iter().filter(|(_, label)| label["kind"] == "single") {
        let effect = &label["effects"][0];
        let (Some(id), Some(value)) = (effect["id"].as_str(), effect["value"].as_f64()) else { continue };
        sizes.insert(name, effect_size(&Case::read(&folder.join(name))?, id, value));
    }
    println!("{}", serde_json::to_string(&sizes)?);
    Ok(())
}
