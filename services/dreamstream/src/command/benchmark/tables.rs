//! `report`: results of a benchmark as tables and a page.

use std::path::Path;

use anyhow::Result;
use ds_benchmark::{Kind, Published, Report, Results, Review, page};

use super::Ended;
use crate::command::answer;

/// Runs `report`.
///
/// # Errors
/// If a file is refused or cannot be written.
pub(super) fn run(folder: &Path, published: &Path) -> Result<Ended> {
    let published = Published::load(published)?;
    let results = Results::load(folder)?;
    let reviewable =
        results.sets.iter().zip(&results.sheet.place.folders).filter(|(set, _)| set.kind == Kind::Behavior);
    let reviews = reviewable.map(|(set, folder)| Review::beside(folder, set)).collect::<Result<_, _>>()?;
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
