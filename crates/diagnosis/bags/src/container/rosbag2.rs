//! rosbag2's SQLite file: tables `topics` and `messages`, since Iron also `message_definitions`.
//!
//! The file is opened for reading only; sizes of cells are bounded, schema functions are not trusted. Bags without definitions
//! are read by those of the usual ROS 2 messages (`usual`).

use std::collections::BTreeMap;
use std::path::Path;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};

use super::{Declared, MAX_BYTES, MAX_TOPICS, Message, Sink};
use crate::definition::{self, Wire};
use crate::error::BagError;
use crate::usual;

/// Reads a file.
pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<(), BagError> {
    let failed = |source| BagError::Sql { path: path.to_path_buf(), source };
    let base = open(path).map_err(failed)?;
    let topics = declared(&base).map_err(failed)?;
    if topics.len() >= MAX_TOPICS {
        return Err(BagError::TooLarge { what: "topics".to_owned(), limit: MAX_TOPICS, path: path.to_path_buf() });
    }
    let mut wanted = Vec::new();
    for (number, topic) in topics {
        if sink.topic(number, topic)? {
            wanted.push(number.to_string());
        }
    }
    // numbers that were read as such a moment ago
    let query = format!("SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({})", wanted.join(","));
    let mut statement = base.prepare(&query).map_err(failed)?;
    let mut rows = statement.query([]).map_err(failed)?;
    while let Some(row) = rows.next().map_err(failed)? {
        let cell = |k| row.get_ref(k).map_err(failed);
        let wrong = |e: rusqlite::types::FromSqlError| failed(rusqlite::Error::from(e));
        sink.message(&Message {
            topic: row.get(0).map_err(failed)?,
            log_nanos: row.get(1).map_err(failed)?,
            publish_nanos: None,
            data: cell(2)?.as_blob().map_err(wrong)?,
        })?;
    }
    Ok(())
}

fn open(path: &Path) -> rusqlite::Result<Connection> {
    let base = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
    base.set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_BYTES as i32)?;
    base.set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
    base.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
    Ok(base)
}

fn declared(base: &Connection) -> rusqlite::Result<Vec<(u32, Declared)>> {
    let own = definitions(base)?;
    let query = format!("SELECT id, name, type, serialization_format FROM topics ORDER BY id LIMIT {MAX_TOPICS}");
    let mut statement = base.prepare(&query)?;
    let rows = statement.query_map([], |row| {
        let (kind, encoding): (String, String) = (row.get(2)?, row.get(3)?);
        let name = definition::plain_name(&kind);
        let definition = if encoding == "cdr" {
            let none = "the bag holds no definition of it (bags since ROS 2 Iron do)";
            let held = own.get(&name).cloned().unwrap_or_else(|| Err(none.to_owned()));
            held.or_else(|why| usual::definition(&name).ok_or(why))
        } else {
            Err(format!("its messages are written in {encoding:?}; cdr is read"))
        };
        Ok((row.get(0)?, Declared { name: row.get(1)?, kind, wire: Wire::Cdr, definition }))
    })?;
    rows.collect()
}

/// Returns the definitions that the bag holds, by type.
fn definitions(base: &Connection) -> rusqlite::Result<BTreeMap<String, Result<String, String>>> {
    let there = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = 'message_definitions'";
    if base.query_row(there, [], |row| row.get::<_, i64>(0))? == 0 {
        return Ok(BTreeMap::new());
    }
    let query =
        format!("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions LIMIT {MAX_TOPICS}");
    let mut statement = base.prepare(&query)?;
    let rows = statement.query_map([], |row| {
        let (kind, encoding): (String, String) = (row.get(0)?, row.get(1)?);
        let text: String = row.get(2)?;
        let read = if encoding == "ros2msg" {
            Ok(text)
        } else {
            Err(format!("its definition is written in {encoding:?}; ros2msg is read"))
        };
        Ok((definition::plain_name(&kind), read))
    })?;
    rows.collect()
}
