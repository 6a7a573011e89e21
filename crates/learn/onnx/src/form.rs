//! What all manifests have in common: TOML in a file, and the digest that the network must have.

use std::path::Path;

use ds_space::Digest;
use serde::de::DeserializeOwned;

use crate::error::OnnxError;
use crate::network::Network;

/// The form of manifests that is known.
pub(crate) const VERSION: u32 = 1;

/// Reads a manifest, with the digest of its text.
///
/// # Errors
/// If it is not there or has another form.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<(T, Digest), OnnxError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|source| OnnxError::Read { path: name.clone(), source })?;
    let form = toml::from_str(&text).map_err(|source| OnnxError::Form { path: name, source: Box::new(source) })?;
    Ok((form, Digest::of(text.as_bytes())))
}

/// Checks that a network is the one that its manifest means.
///
/// # Errors
/// [`OnnxError::Digest`] if it is another one.
pub(crate) fn meant(path: &Path, network: &Network, expected: Option<&String>) -> Result<(), OnnxError> {
    let found = network.digest().to_string();
    match expected.filter(|expected| **expected != found) {
        Some(expected) => {
            Err(OnnxError::Digest { path: path.display().to_string(), found, expected: expected.clone() })
        }
        None => Ok(()),
    }
}
