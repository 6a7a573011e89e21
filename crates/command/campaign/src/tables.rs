//! `report`: results of a benchmark as tables and a page.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use ds_benchmark::{Kind, Published, Quality, Report, Results, Review, Verdicts, page};
use ds_process::terminal::answer;

use crate::{Ended, falls};

/// Runs `report`.
///
/// # Errors
/// If a file is refused or cannot be written.
pub(crate) fn run(folder: &Path, published: &Path, verdicts: &[PathBuf], recordings: &[PathBuf]) -> Result<Ended> {
    let published = Published::load(published)?;
    let mut results = Results::load(folder)?;
    let adverse: Vec<_> =
        results.sets.iter().zip(&results.sheet.place.folders).filter(|(set, _)| set.kind == Kind::Behavior).collect();
    let quality: Vec<Option<Quality>> =
        adverse.iter().map(|(set, folder)| Quality::beside(folder, set)).collect::<Result<_, _>>()?;
    let mut reviews = adverse.iter().map(|(set, folder)| Review::beside(folder, set)).collect::<Result<Vec<_>, _>>()?;
    for path in verdicts {
        let said = Verdicts::load(path)?;
        let review = reviews.iter_mut().find(|review| review.set == said.set);
        let stranger = || format!("{} is of set {:?}, no driven set with adversaries", path.display(), said.set);
        review.with_context(stranger)?.hear(said);
    }
    results.quality = quality.into_iter().flatten().collect();
    results.animations = falls::draw(&results, recordings)?;
    let results = results.reviewed(reviews);
    let anchor = |policy: &str| ds_policy::builtin::NAMES.contains(&(policy, true));
    let report = Report::new(&results, &anchor, &published);
    page::write(&report, folder)?;
    report.warnings.iter().for_each(|warning| answer(warning));
    for table in report.tables.iter().filter(|table| ["policies", "outcomes"].contains(&table.id)) {
        answer(&table.markdown());
    }
    answer(&format!("report: {}", folder.join("report.html").display()));
    Ok(if report.complete { Ended::Complete } else { Ended::Left })
}
