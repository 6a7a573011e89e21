//! Tables of a case, changed row by row.

use std::fs;
use std::path::Path;

/// Cells by rows, the head in front.
pub(crate) type Rows = Vec<Vec<String>>;

/// Returns a table after a change.
pub(crate) fn changed(table: &str, change: impl FnOnce(&mut Rows)) -> String {
    let mut rows: Rows = table.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    change(&mut rows);
    rows.iter().map(|row| row.join(",") + "\n").collect()
}

/// Changes the table of a file.
pub(crate) fn change(path: &Path, change: impl FnOnce(&mut Rows)) {
    let table = fs::read_to_string(path).expect("the drive");
    fs::write(path, changed(&table, change)).expect("the drive can be written");
}
