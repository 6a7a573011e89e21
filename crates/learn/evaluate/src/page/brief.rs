//! The figures that a reader looks for first, of the student alone, column by column.

use ds_page::Markup;

use super::table::{shown, table};
use crate::config::{LAYOUT_TARGETS, STUDENT};
use crate::estimate::Estimate;
use crate::outcome::{ArmLayout, Outcome, Sharpness};

/// Name, digits and figure of a row.
type Row = (&'static str, usize, fn(&Sharpness) -> Option<Estimate>);

/// What is read from the sharpness of whole drives.
const SHARP: [Row; 5] = [
    ("detail, of the world's own", 2, |found| found.laplacian_ratio),
    ("steps at borders of blocks", 2, |found| found.border_ratio),
    ("seam between chunks", 2, |found| found.seam),
    ("PSNR along drives, dB", 1, |found| found.psnr_db),
    ("distance beside the road", 2, |found| found.off_road_distance),
];

/// Writes a row a figure and a column a world; nothing where neither part was measured.
pub(super) fn write(m: &mut Markup, outcome: &Outcome) {
    let columns = outcome.columns();
    let mut rows = Vec::new();
    if let Some(part) = &outcome.sharpness {
        let of = |column: &String| part.columns.get(column)?.get(part.arms.get(STUDENT)?);
        rows.extend(
            SHARP.map(|(name, digits, figure)| row(name, &columns, |column| shown(figure(of(column)?), digits).into())),
        );
    }
    if let Some(part) = &outcome.layout {
        let of = |column: &String| {
            let column = part.columns.get(column)?;
            Some((&column.reference, column.arms.get(part.iou.get(STUDENT)?)?))
        };
        for target in LAYOUT_TARGETS {
            let name = format!("{target} IoU, student / reference frames");
            let figure = |arm: &ArmLayout| shown(arm.iou.get(target).copied().flatten(), 2);
            rows.push(row(&name, &columns, |column| {
                let (reference, student) = of(column)?;
                Some(format!("{} / {}", figure(student), figure(reference)))
            }));
        }
        let frechet = |column: &String| Some(shown(of(column)?.1.frechet, 1));
        rows.push(row("Fréchet distance of features", &columns, frechet));
    }
    if rows.is_empty() {
        return;
    }
    let mut head = vec!["the student"];
    head.extend(columns.iter().map(String::as_str));
    m.leaf("h2", &[], "In brief");
    table(m, &head, &rows);
}

fn row(name: &str, columns: &[String], cell: impl Fn(&String) -> Option<String>) -> Vec<String> {
    let cells = columns.iter().map(|column| cell(column).unwrap_or_else(|| "–".to_owned()));
    std::iter::once(name.to_owned()).chain(cells).collect()
}
