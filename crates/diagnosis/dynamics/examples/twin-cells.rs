//! Where the effects of a world's cases show, as JSON by case: the cells, channel and drive, with the root mean square by which
//! the case differs from its twin without effects (`CASES/without`), in floor units; null where the two cannot be compared.
#![expect(clippy::print_stdout, reason = "the table is this example's answer")]

use std::collections::BTreeMap;
use std::path::Path;

use ds_diagnosis::json;
use ds_dynamics::size::{CellSizes, twin_cells, with_twin};

/// Sizes of a case's cells by channel, one per drive.
type Cells = BTreeMap<&'static str, BTreeMap<usize, f64>>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("a folder of cases with labels.json and twins")?;
    let folder = Path::new(&folder);
    let labels: BTreeMap<String, serde_json::Value> = json::read(&folder.join("labels.json"))?;
    let mut found: BTreeMap<String, Option<Cells>> = BTreeMap::new();
    for name in labels.keys() {
        if let Some([case, twin]) = with_twin(folder, name)? {
            found.insert(name.clone(), twin_cells(&case, &twin).map(by_channel));
        }
    }
    println!("{}", serde_json::to_string(&found)?);
    Ok(())
}

fn by_channel(sizes: CellSizes) -> Cells {
    let mut cells = Cells::new();
    for ((channel, drive), size) in sizes {
        cells.entry(channel.name()).or_default().insert(drive, size);
    }
    cells
}
