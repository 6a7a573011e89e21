//! The container's own checksums over a whole file in memory: of the data section, of the summary, and the end mark.
//!
//! The checksums of single chunks are compared where their messages are taken out, see `scan`.

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::LinearReaderOptions;

use crate::linear;

/// How much of a file its checksums cover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Present {
    /// Data section and summary have one each.
    All,
    /// One of them has none, as some writers leave it.
    Some,
}

/// Compares the checksums that are there, or says which of them fails.
pub(crate) fn verify(bytes: &[u8]) -> Result<Present, String> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true);
    let mut checksums = [0, 0];
    let failed = |error: McapError| error.to_string();
    linear::each(bytes, options, failed, |opcode, data| {
        if matches!(opcode, op::DATA_END | op::FOOTER) {
            match mcap::parse_record(opcode, data).map_err(failed)? {
                Record::DataEnd(end) => checksums[0] = end.data_section_crc,
                Record::Footer(footer) => checksums[1] = footer.summary_crc,
                _ => {}
            }
        }
        Ok(())
    })?;
    Ok(if checksums.contains(&0) { Present::Some } else { Present::All })
}
