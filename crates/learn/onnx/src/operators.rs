//! Which operators of a network cannot be computed, or not twice alike.

use std::collections::BTreeMap;

use tract_onnx::pb::{GraphProto, ModelProto};

/// Operators that draw random numbers outside the seed of an episode.
const RANDOM: [&str; 6] =
    ["Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike"];

/// Returns what is wrong with the operators of a network, subgraphs included; none if nothing is.
pub(crate) fn problem(model: &ModelProto) -> Option<String> {
    let mut counts = BTreeMap::new();
    if let Some(graph) = &model.graph {
        count(graph, &mut counts);
    }
    let known = tract_onnx::onnx().op_register.0;
    let nodes = |number: &usize| if *number == 1 { "1 node".to_owned() } else { format!("{number} nodes") };
    let named = |says: &str, (name, number): (&String, &usize)| format!("{name} {says} ({})", nodes(number));
    let random = counts.iter().filter(|(name, _)| RANDOM.contains(&name.as_str()));
    let random = random.map(|found| named("draws outside the seed", found));
    let unknown = counts.iter().filter(|(name, _)| !RANDOM.contains(&name.as_str()) && !known.contains_key(*name));
    let unknown = unknown.map(|found| named("is not known", found));
    let all: Vec<String> = random.chain(unknown).collect();
    (!all.is_empty()).then(|| all.join(", "))
}

fn count(graph: &GraphProto, counts: &mut BTreeMap<String, usize>) {
    for node in &graph.node {
        *counts.entry(node.op_type.clone()).or_default() += 1;
        for attribute in &node.attribute {
            attribute.g.iter().chain(&attribute.graphs).for_each(|inner| count(inner, counts));
        }
    }
}
