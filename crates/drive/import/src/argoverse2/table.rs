//! Tables of a log: columns by name, from Feather or CSV; every refusal names the file, the column and the row.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_space::{DQuat, DVec3};

use super::column::{Column, MAX_ROWS};
use super::feather;
use crate::error::ImportError;
use crate::file::bytes;
use crate::view::FieldFault;

const CONVERT: &str =
    "python3 -c \"import pandas, sys; p = sys.argv[1]; pandas.read_parquet(p).to_csv(p[:-7] + 'csv', index=False)\"";

/// Columns of one length.
#[derive(Debug)]
pub(super) struct Table {
    path: PathBuf,
    pub rows: usize,
    columns: BTreeMap<String, Column>,
}

impl Table {
    /// Reads those of the wanted columns that a file has.
    pub(super) fn read(path: &Path, wanted: &[&str]) -> Result<Self, ImportError> {
        let extension = path.extension().unwrap_or_default();
        if extension == "parquet" {
            return Err(ImportError::Parquet { path: path.to_owned(), command: CONVERT });
        }
        let bytes = bytes(path)?;
        let columns = if extension == "feather" { feather::columns(&bytes, wanted) } else { csv(&bytes, wanted) };
        let (rows, columns) = columns.map_err(|fault| ImportError::field(path, fault))?;
        Ok(Self { path: path.to_owned(), rows, columns })
    }

    pub(super) fn fault(&self, at: impl Into<String>, problem: impl Into<String>) -> ImportError {
        ImportError::field(&self.path, FieldFault { at: at.into(), problem: problem.into() })
    }

    fn column(&self, name: &str) -> Result<&Column, ImportError> {
        self.columns.get(name).ok_or_else(|| self.fault(name, "is no column of the table"))
    }

    /// Returns a column of finite numbers.
    pub(super) fn numbers(&self, name: &str) -> Result<Vec<f64>, ImportError> {
        let refuse = |row: usize, found: &dyn std::fmt::Debug| {
            self.fault(format!("{name}[{row}]"), format!("is {found:?}, no finite number"))
        };
        let numbers: Vec<f64> = match self.column(name)? {
            Column::Numbers(numbers) => numbers.clone(),
            Column::Texts(texts) => (0..)
                .zip(texts)
                .map(|(row, text)| text.parse().map_err(|_: std::num::ParseFloatError| refuse(row, text)))
                .collect::<Result<_, _>>()?,
        };
        match numbers.iter().position(|number| !number.is_finite()) {
            Some(row) => Err(refuse(row, &numbers[row])),
            None => Ok(numbers),
        }
    }

    /// Returns columns of finite numbers, row by row.
    pub(super) fn vectors<const N: usize>(&self, names: [&str; N]) -> Result<Vec<[f64; N]>, ImportError> {
        let columns = names.into_iter().map(|name| self.numbers(name)).collect::<Result<Vec<_>, _>>()?;
        Ok((0..self.rows).map(|row| std::array::from_fn(|i| columns[i][row])).collect())
    }

    /// Returns positions `tx_m`, `ty_m`, `tz_m` with rotations `qw`, `qx`, `qy`, `qz`.
    pub(super) fn poses(&self) -> Result<Vec<(DVec3, DQuat)>, ImportError> {
        let positions = self.vectors(["tx_m", "ty_m", "tz_m"])?;
        let rotations = self.vectors(["qw", "qx", "qy", "qz"])?;
        let pose = |(row, (position, [w, x, y, z])): (usize, ([f64; 3], [f64; 4]))| {
            let rotation = DQuat::from_xyzw(x, y, z, w);
            if (rotation.length() - 1.0).abs() > 0.01 {
                let problem = format!("is a quaternion of length {}, not of 1", rotation.length());
                return Err(self.fault(format!("qw[{row}]"), problem));
            }
            Ok((DVec3::from_array(position), rotation.normalize()))
        };
        positions.into_iter().zip(rotations).enumerate().map(pose).collect()
    }

    /// Returns a column of texts; numbers are written out.
    pub(super) fn texts(&self, name: &str) -> Result<Vec<String>, ImportError> {
        Ok(match self.column(name)? {
            Column::Numbers(numbers) => numbers.iter().map(f64::to_string).collect(),
            Column::Texts(texts) => texts.clone(),
        })
    }
}

/// Reads comma-separated values with a head; cells hold no commas.
fn csv(bytes: &[u8], wanted: &[&str]) -> Result<(usize, BTreeMap<String, Column>), FieldFault> {
    let fault = |at: String, problem: String| FieldFault { at, problem };
    let text =
        std::str::from_utf8(bytes).map_err(|error| fault("text".to_owned(), format!("is not UTF-8: {error}")))?;
    let mut lines = text.trim_start_matches('\u{feff}').lines().filter(|line| !line.trim().is_empty());
    let bare = |cell: &str| cell.trim().trim_matches('"').to_owned();
    let head = lines.next().ok_or_else(|| fault("head".to_owned(), "is missing".to_owned()))?;
    let head: Vec<String> = head.split(',').map(bare).collect();
    let mut columns: Vec<Option<Vec<String>>> =
        head.iter().map(|name| wanted.contains(&name.as_str()).then(Vec::new)).collect();
    let mut rows = 0;
    for line in lines {
        let row = line.split(',');
        let count = row.clone().count();
        if count != head.len() {
            return Err(fault(format!("row {rows}"), format!("has {count} cells, the head has {}", head.len())));
        }
        if rows == MAX_ROWS {
            return Err(fault(format!("row {rows}"), format!("is over the limit of {MAX_ROWS} rows")));
        }
        rows += 1;
        for (cell, column) in row.zip(&mut columns) {
            if let Some(column) = column {
                column.push(bare(cell));
            }
        }
    }
    let columns = head.into_iter().zip(columns).filter_map(|(name, cells)| Some((name, Column::Texts(cells?))));
    Ok((rows, columns.collect()))
}
