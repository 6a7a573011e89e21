//! How well diagnoses say where the gap lies: their cells against those in which a case truly differs from its twin, the same
//! drives with the same noise in a world without the effect.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ds_diagnosis::schema::{self, Cell, Regime};
use ds_diagnosis::score::{Share, read_labels};
use ds_diagnosis::{Diagnosis, json};
use ds_dynamics::settings::CELL_SIZE;
use ds_dynamics::size::{CellSizes, twin_cells, with_twin};
use ds_stats::quantile;
use serde::Serialize;

use crate::error::CasesError;

/// Overlap from which on a case counts as located.
const LOCATED: f64 = 0.5;

/// A channel of a whole drive.
type Place = (String, usize);

/// One case: the places that were named and those in which its effects show.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Located {
    /// Named, and an effect shows there.
    pub right: BTreeSet<Place>,
    /// Named, and nothing shows there.
    pub wrong: BTreeSet<Place>,
    /// Not named, though an effect shows there.
    pub missed: BTreeSet<Place>,
}

impl Located {
    /// Compares the cells of a diagnosis with the sizes of what its case's effects change. Cells of a part of a drive count for
    /// nothing here: sizes are of whole ones. An effect shows from the size on from which diagnoses name a cell.
    #[must_use]
    pub fn new(cells: &[Cell], sizes: &CellSizes) -> Self {
        let whole = |regime: &Regime| *regime == Regime { drive: regime.drive, ..Regime::default() };
        let named =
            cells.iter().filter(|cell| whole(&cell.regime)).map(|cell| (cell.channel.clone(), cell.regime.drive));
        let named: BTreeSet<Place> = named.collect();
        let shown = sizes.iter().filter(|(_, size)| **size >= CELL_SIZE);
        let shown: BTreeSet<Place> = shown.map(|((channel, drive), _)| (channel.name().to_owned(), *drive)).collect();
        Self { right: &named & &shown, wrong: &named - &shown, missed: &shown - &named }
    }

    /// Intersection over union of what was named and what shows; `None` where nothing shows.
    #[must_use]
    pub fn overlap(&self) -> Option<f64> {
        let shown = self.right.len() + self.missed.len();
        (shown > 0).then(|| self.right.len() as f64 / (shown + self.wrong.len()) as f64)
    }
}

/// The figures of a folder.
#[derive(Debug, Clone, Serialize)]
pub struct Localisation {
    /// Each case that has a diagnosis and a twin cut into the same windows.
    pub cases: BTreeMap<String, Located>,
    /// Median overlap of the cases in which anything shows.
    pub median_overlap: Option<f64>,
    /// Cases with an overlap of one half or more, among those.
    pub located: Share,
    /// Named places in which nothing shows, among all that were named.
    pub wrong: Share,
    /// Places in which an effect shows that were named, among all of them.
    pub found: Share,
    /// Labelled cases without a diagnosis or a comparable twin.
    pub left_out: Vec<String>,
}

/// Compares the diagnoses of a folder with the twins of the world that the cases are from.
///
/// # Errors
/// If labels, a diagnosis, a case or a twin cannot be read.
pub fn localisation(diagnoses: &Path, labels: &Path, world: &Path) -> Result<Localisation, CasesError> {
    let (mut cases, mut left_out) = (BTreeMap::new(), Vec::new());
    for name in read_labels(labels)?.into_keys() {
        let diagnosis = diagnoses.join(&name).join(schema::FILE);
        let pair = if diagnosis.exists() { with_twin(world, &name)? } else { None };
        match pair.and_then(|[case, twin]| twin_cells(&case, &twin)) {
            Some(sizes) => {
                let found: Diagnosis = json::read(&diagnosis)?;
                cases.insert(name, Located::new(&found.cells, &sizes));
            }
            None => left_out.push(name),
        }
    }
    let mut overlaps: Vec<f64> = cases.values().filter_map(Located::overlap).collect();
    let sum = |of: fn(&Located) -> usize| cases.values().map(of).sum::<usize>();
    let (right, wrong, missed) = (sum(|c| c.right.len()), sum(|c| c.wrong.len()), sum(|c| c.missed.len()));
    Ok(Localisation {
        located: Share::new(overlaps.iter().filter(|overlap| **overlap >= LOCATED).count(), overlaps.len()),
        median_overlap: (!overlaps.is_empty()).then(|| quantile(&mut overlaps, 0.5)),
        wrong: Share::new(wrong, right + wrong),
        found: Share::new(right, right + missed),
        cases,
        left_out,
    })
}

#[cfg(test)]
mod tests {
    use ds_effect::Channel;

    use super::*;

    fn cell(channel: Channel, regime: Regime) -> Cell {
        Cell { channel: channel.name().to_owned(), regime, effect_size: 3.0, q_value: None, t: Vec::new() }
    }

    #[test]
    fn cells_of_whole_drives_are_counted_against_where_the_effect_shows() {
        let whole = |drive| Regime { drive, ..Regime::default() };
        let named = [
            cell(Channel::YawRate, whole(0)),
            cell(Channel::Speed, whole(0)),
            cell(Channel::Speed, Regime { speed: Some("low".to_owned()), ..whole(1) }),
        ];
        let sizes = CellSizes::from([
            ((Channel::YawRate, 0), 4.0),
            ((Channel::YawRate, 1), 1.5),
            ((Channel::Speed, 0), 0.2),
            ((Channel::Speed, 1), 0.0),
        ]);
        let located = Located::new(&named, &sizes);
        let place = |channel: Channel, drive| BTreeSet::from([(channel.name().to_owned(), drive)]);
        let expected = Located {
            right: place(Channel::YawRate, 0),
            wrong: place(Channel::Speed, 0),
            missed: place(Channel::YawRate, 1),
        };
        assert_eq!(located, expected);
        assert_eq!(located.overlap(), Some(1.0 / 3.0));
        assert_eq!(Located::new(&named, &CellSizes::new()).overlap(), None, "nothing shows anywhere");
    }
}
