//! Definitions of the usual ROS 2 messages, for SQLite bags that hold none; those alone whose fields are the same in every
//! release.

/// The definitions, each after a line of `=` and its name.
const TEXT: &str = include_str!("usual.txt");

/// Returns the definition of a type with all that it is made of.
pub(crate) fn definition(name: &str) -> Option<String> {
    let mut parts = TEXT.split("========\nMSG: ").filter_map(|part| part.split_once('\n'));
    let (_, own) = parts.find(|(kind, _)| *kind == name)?;
    Some(format!("{own}{TEXT}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definition::{Schema, Wire};

    #[test]
    fn every_usual_message_is_whole() {
        let names = TEXT.lines().filter_map(|line| line.strip_prefix("MSG: "));
        let mut count = 0;
        for name in names {
            let text = definition(name).expect("it is in the list");
            Schema::parse(name, &text, Wire::Cdr).expect(name);
            count += 1;
        }
        assert!(count > 30, "{count}");
        assert_eq!(definition("own_msgs/Unknown"), None);
    }
}
