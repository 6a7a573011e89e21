//! Networks made here, byte by byte as a file has them.

use prost::Message;
use tract_onnx::pb::tensor_proto::DataType;
use tract_onnx::pb::{NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorShapeProto, TypeProto};
use tract_onnx::pb::{tensor_proto, tensor_shape_proto, type_proto};

use super::*;

fn tensor(name: &str, elem_type: i32, sides: &[i64]) -> ValueInfoProto {
    use tensor_shape_proto::dimension::Value;
    let side = |side: &i64| tensor_shape_proto::Dimension {
        value: Some(if *side < 0 { Value::DimParam("batch".to_owned()) } else { Value::DimValue(*side) }),
        ..tensor_shape_proto::Dimension::default()
    };
    let shape = Some(TensorShapeProto { dim: sides.iter().map(side).collect() });
    let value = Some(type_proto::Value::TensorType(type_proto::Tensor { elem_type, shape }));
    let kind = TypeProto { value, ..TypeProto::default() };
    ValueInfoProto { name: name.to_owned(), r#type: Some(kind), ..ValueInfoProto::default() }
}

fn node(operator: &str, inputs: &[&str], output: &str) -> NodeProto {
    NodeProto {
        op_type: operator.to_owned(),
        name: output.to_owned(),
        input: inputs.iter().map(|&name| name.to_owned()).collect(),
        output: vec![output.to_owned()],
        ..NodeProto::default()
    }
}

/// `plan` = 2 · `state` + `bias`, the state of one row and two columns in a batch of any size.
fn model() -> ModelProto {
    let weight = |name: &str, values: [f32; 2]| TensorProto {
        name: name.to_owned(),
        dims: vec![2],
        data_type: DataType::Float as i32,
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..TensorProto::default()
    };
    let graph = GraphProto {
        name: "twice".to_owned(),
        node: vec![node("Mul", &["state", "two"], "doubled"), node("Add", &["doubled", "bias"], "plan")],
        initializer: vec![weight("two", [2.0, 2.0]), weight("bias", [0.5, -0.5])],
        input: vec![tensor("state", SINGLE, &[-1, 2])],
        output: vec![tensor("plan", SINGLE, &[-1, 2])],
        ..GraphProto::default()
    };
    let opset = OperatorSetIdProto { version: 17, ..OperatorSetIdProto::default() };
    ModelProto { ir_version: 8, opset_import: vec![opset], graph: Some(graph), ..ModelProto::default() }
}

fn read(model: &ModelProto, inputs: &[(&str, &[usize])]) -> Result<Network, OnnxError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("network.onnx");
    std::fs::write(&path, model.encode_to_vec()).expect("write");
    let inputs: Vec<Named> =
        inputs.iter().map(|(name, shape)| Named { name: (*name).to_owned(), shape: shape.to_vec() }).collect();
    Network::read(&path, &inputs, &["plan".to_owned()])
}

fn refused(change: impl Fn(&mut GraphProto), inputs: &[(&str, &[usize])]) -> String {
    let mut model = model();
    change(model.graph.as_mut().expect("there is a graph"));
    read(&model, inputs).expect_err("refused").to_string()
}

const STATE: [(&str, &[usize]); 1] = [("state", &[1, 2])];

#[test]
fn a_network_answers_with_the_shape_of_its_inputs_and_the_same_each_time() {
    let network = read(&model(), &STATE).expect("sound");
    assert_eq!(network.outputs(), [vec![1, 2]]);
    for _ in 0..3 {
        let answer = network.answer(&[Array::new(&[1, 2], vec![1.0, 3.0])]).expect("computed");
        assert_eq!(answer, [Array::new(&[1, 2], vec![2.5, 5.5])]);
    }
    let wrong = network.answer(&[Array::new(&[1, 3], vec![0.0; 3])]).expect_err("another shape").to_string();
    assert!(wrong.contains("cannot be computed"), "{wrong}");
}

#[test]
fn operators_that_are_not_known_or_draw_are_all_named_before_anything_is_built() {
    let says = refused(
        |graph| {
            graph.node[0].op_type = "RandomNormalLike".to_owned();
            graph.node[1].op_type = "DeformConv".to_owned();
            graph.node.push(node("Unique", &["plan"], "one"));
            graph.node.push(node("Unique", &["plan"], "other"));
        },
        &STATE,
    );
    assert!(says.contains("RandomNormalLike draws outside the seed (1 node)"), "{says}");
    assert!(says.contains("DeformConv is not known (1 node), Unique is not known (2 nodes)"), "{says}");
}

#[test]
fn inputs_and_outputs_that_do_not_fit_are_named() {
    let untouched = |_: &mut GraphProto| {};
    for (says, error) in [
        ("has no input \"speed\", it takes \"state\"", refused(untouched, &[("state", &[1, 2]), ("speed", &[1, 1])])),
        ("input \"state\" is not named", refused(untouched, &[])),
        ("has shape [?, 2], the manifest gives [1, 3]", refused(untouched, &[("state", &[1, 3])])),
        ("element type 10", refused(|graph| graph.input[0] = tensor("state", 10, &[1, 2]), &STATE)),
        (
            "has no output \"plan\", it gives \"answer\"",
            refused(|graph| graph.output[0].name = "answer".to_owned(), &STATE),
        ),
        ("nothing makes \"nowhere\"", refused(|graph| graph.node[1].input[1] = "nowhere".to_owned(), &STATE)),
        ("graph has no node", refused(|graph| graph.node.clear(), &STATE)),
    ] {
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }
}

#[test]
fn weights_outside_the_folder_are_refused_and_those_beside_count_for_the_digest() {
    let outside = |graph: &mut GraphProto| {
        let entry = |key: &str, value: &str| StringStringEntryProto { key: key.to_owned(), value: value.to_owned() };
        graph.initializer[1].raw_data = Vec::new();
        graph.initializer[1].data_location = Some(tensor_proto::DataLocation::External as i32);
        graph.initializer[1].external_data = vec![entry("location", "../weights.bin")];
    };
    let says = refused(outside, &STATE);
    assert!(says.contains("\"../weights.bin\", which is not beside it"), "{says}");
    let mut other = model();
    other.graph.as_mut().expect("a graph").initializer[1].raw_data[0] ^= 1;
    let digest = |model: &ModelProto| *read(model, &STATE).expect("sound").digest();
    assert_ne!(digest(&model()), digest(&other));
}

#[test]
fn a_file_that_is_no_network_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("network.onnx");
    for bytes in [&b"not a network"[..], &[], &model().encode_to_vec()[..40]] {
        std::fs::write(&path, bytes).expect("write");
        let error = Network::read(&path, &[], &[]).expect_err("refused").to_string();
        assert!(error.contains("is no ONNX file"), "{error}");
    }
}
