//! What a bag holds: its topics with type, number of messages and the paths of all numbers that are no element of a list.

use std::collections::BTreeMap;
use std::path::Path;

use crate::container::{Declared, Format, Message, Sink};
use crate::definition::{self, Count, Held, Schema};
use crate::error::BagError;

/// Most paths of a topic.
const MAX_LEAVES: usize = 400;

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Type of its messages, as `nav_msgs/Odometry`.
    pub kind: String,
    /// Number of its messages.
    pub messages: u64,
    /// When the first and the last message were received, ns.
    pub received_nanos: Option<(i64, i64)>,
    /// Paths of its numbers, or what stands in the way of reading them.
    pub leaves: Result<Vec<String>, String>,
}

/// Returns the topics of a bag in the order of their names.
///
/// # Errors
/// If the bag is damaged.
pub fn topics(path: &Path, format: Format) -> Result<Vec<Topic>, BagError> {
    let mut list = List::default();
    format.read(path, &mut list)?;
    Ok(list.topics.into_values().collect())
}

#[derive(Default)]
struct List {
    names: BTreeMap<u32, String>,
    topics: BTreeMap<String, Topic>,
}

impl Sink for List {
    fn begin(&mut self, _path: &Path) {
        self.names.clear();
    }

    fn topic(&mut self, number: u32, declared: Declared) -> Result<bool, BagError> {
        let Declared { name, kind, wire, definition } = declared;
        self.names.insert(number, name.clone());
        let leaves = definition.and_then(|text| Schema::parse(&kind, &text, wire)).map(|schema| {
            let mut leaves = Vec::new();
            collect(&schema, 0, "", &mut leaves);
            leaves
        });
        let kind = definition::plain_name(&kind);
        let topic = Topic { name: name.clone(), kind, messages: 0, received_nanos: None, leaves };
        self.topics.entry(name).or_insert(topic);
        Ok(true)
    }

    fn message(&mut self, message: &Message<'_>) -> Result<(), BagError> {
        if let Some(topic) = self.names.get(&message.topic).and_then(|name| self.topics.get_mut(name)) {
            topic.messages += 1;
            let (first, last) = topic.received_nanos.unwrap_or((message.log_nanos, message.log_nanos));
            topic.received_nanos = Some((first.min(message.log_nanos), last.max(message.log_nanos)));
        }
        Ok(())
    }
}

fn collect(schema: &Schema, place: usize, prefix: &str, leaves: &mut Vec<String>) {
    for member in &schema.structures[place].members {
        if leaves.len() >= MAX_LEAVES || member.count != Count::One {
            continue;
        }
        let path = format!("{prefix}{}", member.name);
        match member.held {
            Held::Number(_) => leaves.push(path),
            Held::Structure(other) => collect(schema, other, &(path + "."), leaves),
            Held::Text | Held::WideText => {}
        }
    }
}
