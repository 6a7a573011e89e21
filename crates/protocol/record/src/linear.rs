//! Feeds bytes in memory to the container library's reader and hands on its records.

use mcap::McapError;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// The most bytes of one chunk, compressed or not.
const MAX_CHUNK_BYTES: usize = 1 << 30;

/// Hands on opcode and body of every record; what the library refuses is told by `refused`.
pub(crate) fn each<E>(
    bytes: &[u8],
    options: LinearReaderOptions,
    refused: impl Fn(McapError) -> E,
    mut take: impl FnMut(u8, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let mut reader = LinearReader::new_with_options(options.with_record_length_limit(MAX_CHUNK_BYTES));
    let mut rest = bytes;
    while let Some(event) = reader.next_event() {
        match event.map_err(&refused)? {
            LinearReadEvent::ReadRequest(need) => {
                let (now, later) = rest.split_at(need.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, data } => take(opcode, data)?,
        }
    }
    Ok(())
}
