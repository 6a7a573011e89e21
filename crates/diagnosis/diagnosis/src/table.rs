//! Reads a comma-separated table of numbers: one head line, empty cells as absent, bounded size, named errors.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;

use crate::error::CaseError;

/// Step of the common clock on which drives are diagnosed, s.
pub const STEP_SECS: f64 = 0.05;
/// Most rows a log may have: 2 h at 200 Hz.
pub const MAX_ROWS: usize = 1_440_000;
/// Most columns a log may have.
pub const MAX_COLUMNS: usize = 64;
/// Largest size of a value, in whatever unit: what is beyond is no measurement and overflows when it is squared.
pub const MAX_VALUE: f64 = 1e15;
/// Most bytes a log may have.
pub const MAX_BYTES: usize = 400 << 20;

/// Columns of numbers by name; an absent cell is NaN.
#[derive(Debug, Clone, Default)]
pub struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    file: String,
}

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is too large, ragged, or holds a cell that is neither empty nor a number of at most
    /// [`MAX_VALUE`].
    pub fn read(path: &Path) -> Result<Self, CaseError> {
        let file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let failed = |source| CaseError::Read { path: path.to_path_buf(), source };
        let reader = BufReader::new(File::open(path).map_err(failed)?.take(MAX_BYTES as u64 + 1));
        let mut table = Self { file, ..Self::default() };
        let mut bytes = 0;
        let mut row = 0;
        for line in reader.lines() {
            let line = line.map_err(failed)?;
            bytes += line.len() + 1;
            if bytes > MAX_BYTES {
                return Err(table.too_large("bytes", MAX_BYTES));
            }
            let line = line.trim_start_matches('\u{feff}').trim_end();
            if table.names.is_empty() {
                table.names = line.split(',').map(|name| name.trim().to_owned()).collect();
                if table.names.len() > MAX_COLUMNS {
                    return Err(table.too_large("columns", MAX_COLUMNS));
                }
                table.columns = vec![Vec::new(); table.names.len()];
            } else if !line.is_empty() {
                row += 1;
                if row > MAX_ROWS {
                    return Err(table.too_large("rows", MAX_ROWS));
                }
                table.push(row, line)?;
            }
        }
        Ok(table)
    }

    /// Makes a table of columns of one length by name.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn new(file: &str, columns: Vec<(String, Vec<f64>)>) -> Result<Self, CaseError> {
        for (name, column) in &columns {
            if let Some(row) = column.iter().position(|value| !value.is_finite()) {
                let (column, text, file) = (name.clone(), column[row].to_string(), file.to_owned());
                return Err(CaseError::NotANumber { row: row + 1, column, text, file });
            }
        }
        let (names, columns) = columns.into_iter().unzip();
        Ok(Self { names, columns, file: file.to_owned() })
    }

    fn too_large(&self, what: &'static str, limit: usize) -> CaseError {
        CaseError::TooLarge { what, limit, file: self.file.clone() }
    }

    fn push(&mut self, row: usize, line: &str) -> Result<(), CaseError> {
        let cells = line.split(',').count();
        if cells != self.names.len() {
            return Err(CaseError::RaggedRow { row, cells, columns: self.names.len(), file: self.file.clone() });
        }
        for (cell, (name, column)) in line.split(',').zip(self.names.iter().zip(&mut self.columns)) {
            let text = cell.trim();
            let value =
                if text.is_empty() { Some(f64::NAN) } else { text.parse().ok().filter(|v: &f64| v.abs() <= MAX_VALUE) };
            column.push(value.ok_or_else(|| CaseError::NotANumber {
                row,
                column: name.clone(),
                text: text.chars().take(24).collect(),
                file: self.file.clone(),
            })?);
        }
        Ok(())
    }

    /// Returns the text of the table's file, every value to the bit.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = self.names.join(",") + "\n";
        for row in 0..self.rows() {
            let cells: Vec<String> = self.columns.iter().map(|column| column[row].to_string()).collect();
            text += &(cells.join(",") + "\n");
        }
        text
    }

    /// Returns a column, `None` if it is not there or wholly empty.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let at = self.names.iter().position(|n| n == name)?;
        let column = self.columns[at].as_slice();
        column.iter().any(|v| v.is_finite()).then_some(column)
    }

    /// Returns a column that must be there.
    ///
    /// # Errors
    /// If it is not.
    pub fn required(&self, name: &'static str) -> Result<&[f64], CaseError> {
        self.column(name).ok_or_else(|| CaseError::MissingColumn { column: name, file: self.file.clone() })
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Returns the file's name.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }
}
