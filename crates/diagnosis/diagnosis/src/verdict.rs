//! A verdict in JSON: its name.

use ds_effect::Verdict;
use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};

/// Writes the name.
///
/// # Errors
/// As the writer does.
pub fn serialize<S: Serializer>(verdict: &Verdict, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(verdict.name())
}

/// Reads the name.
///
/// # Errors
/// If there is no such verdict.
pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Verdict, D::Error> {
    let name = String::deserialize(from)?;
    Verdict::ALL
        .into_iter()
        .find(|verdict| verdict.name() == name)
        .ok_or_else(|| D::Error::custom(format_args!("no verdict is called {name:?}")))
}
