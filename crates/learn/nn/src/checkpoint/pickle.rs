//! The tensors of a pickle as PyTorch writes it, by their names in nested dictionaries.

use std::collections::BTreeMap;

use ds_pickle::{AllowList, Node, Pickle, PickleError, Tensor, Value};

/// The longest accepted pickle, in bytes.
const MAX_BYTES: usize = 16 << 20;
const MAX_VALUES: usize = 1 << 18;
const MAX_DEPTH: usize = 8;
const MAX_NAME: usize = 512;

#[derive(Default)]
struct Found {
    tensors: BTreeMap<String, Tensor>,
    visited: usize,
}

/// Returns the tensors of a pickled dictionary by name; names of nested dictionaries are joined with dots.
pub(super) fn tensors(bytes: &[u8]) -> Result<BTreeMap<String, Tensor>, PickleError> {
    if bytes.len() > MAX_BYTES {
        return Err(PickleError::TooLarge { offset: 0, limit: MAX_BYTES });
    }
    let pickle = ds_pickle::read(bytes, AllowList::Tensors)?;
    let mut found = Found::default();
    collect(&pickle, pickle.root, "", 0, &mut found)
        .map_err(|problem| PickleError::Malformed { offset: bytes.len(), problem: problem.to_owned() })?;
    Ok(found.tensors)
}

fn node(pickle: &Pickle, value: Value) -> Option<&Node> {
    match value {
        Value::Node(index) => pickle.nodes.get(index),
        _ => None,
    }
}

fn collect(pickle: &Pickle, value: Value, prefix: &str, depth: usize, found: &mut Found) -> Result<(), &'static str> {
    let Some(Node::Dict(pairs)) = node(pickle, value) else { return Err("it holds no dictionary of tensors") };
    for (key, value) in pairs {
        found.visited += 1;
        let Some(Node::Text(key)) = node(pickle, *key) else { continue };
        if depth == MAX_DEPTH || found.visited > MAX_VALUES || prefix.len() + key.len() > MAX_NAME {
            return Err("its dictionaries are nested too deeply or hold too much");
        }
        let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match node(pickle, *value) {
            Some(Node::Tensor(tensor)) => {
                found.tensors.insert(name, (**tensor).clone());
            }
            Some(Node::Dict(_)) => collect(pickle, *value, &name, depth + 1, found)?,
            _ => {}
        }
    }
    Ok(())
}
