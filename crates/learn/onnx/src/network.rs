//! A network of an ONNX file, with shapes fixed when it is read.

use std::fmt::{self, Display};
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use ds_nn::Array;
use ds_space::{Digest, DigestWriter};
use tract_onnx::pb::{GraphProto, ModelProto, TensorProto, ValueInfoProto, type_proto};
use tract_onnx::prelude::*;

use crate::error::OnnxError;
use crate::operators;

/// An input by name with its shape.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// The name in the network.
    pub name: String,
    /// Sides, slowest first.
    pub shape: Vec<usize>,
}

/// A network that can be asked; copies share it.
#[derive(Clone)]
pub struct Network {
    path: String,
    plan: Arc<TypedRunnableModel>,
    outputs: Vec<Vec<usize>>,
    digest: Digest,
}

impl fmt::Debug for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Network").field("path", &self.path).field("digest", &self.digest).finish_non_exhaustive()
    }
}

impl Network {
    /// Reads a network that takes exactly these inputs and gives at least these outputs, all of single precision.
    ///
    /// # Errors
    /// [`OnnxError`] names operators that are not known or draw random numbers, inputs and outputs that are missing or left
    /// over, and sides that differ.
    pub fn read(path: &Path, inputs: &[Named], outputs: &[String]) -> Result<Self, OnnxError> {
        let name = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| OnnxError::Read { path: name.clone(), source })?;
        let onnx = tract_onnx::onnx();
        let model = guarded(&name, "is no ONNX file", || onnx.proto_model_for_read(&mut Cursor::new(&bytes)))?;
        let graph = model.graph.as_ref().filter(|graph| !graph.node.is_empty());
        let graph = graph.ok_or_else(|| shape(&name, "is no ONNX file, or its graph has no node".to_owned()))?;
        if let Some(operators) = operators::problem(&model) {
            return Err(OnnxError::Operators { path: name, operators });
        }
        check_inputs(&name, graph, inputs)?;
        check_outputs(&name, graph, outputs)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let digest = digest(&name, &bytes, graph, folder)?;
        let plan = guarded(&name, "cannot be prepared", || prepare(&onnx, &model, folder, inputs, outputs))?;
        let sides = |index: usize| {
            let fact = plan.model().output_fact(index)?;
            if fact.datum_type != f32::datum_type() {
                return Err(TractError::msg(format!("output is {:?}, not of single precision", fact.datum_type)));
            }
            let sides = fact.shape.as_concrete();
            sides.map(<[usize]>::to_vec).ok_or_else(|| TractError::msg("a side is not fixed by the inputs"))
        };
        let sides = outputs
            .iter()
            .enumerate()
            .map(|(index, output)| sides(index).map_err(|error| shape(&name, format!("output {output:?}: {error}"))));
        Ok(Self { outputs: sides.collect::<Result<_, _>>()?, plan, digest, path: name })
    }

    /// Returns the sides of each output, in the order in which they were asked for.
    #[must_use]
    pub fn outputs(&self) -> &[Vec<usize>] {
        &self.outputs
    }

    /// Returns the digest of the file and of all files of weights beside it.
    #[must_use]
    pub fn digest(&self) -> &Digest {
        &self.digest
    }

    /// Computes the outputs of inputs, both in the order of [`Network::read`].
    ///
    /// # Errors
    /// [`OnnxError::Compute`] if the library fails or panics.
    pub fn answer(&self, inputs: &[Array]) -> Result<Vec<Array>, OnnxError> {
        guarded(&self.path, "cannot be computed", || {
            let tensor = |array: &Array| Tensor::from_shape(array.shape(), array.values()).map(TValue::from);
            let inputs: TVec<TValue> = inputs.iter().map(tensor).collect::<TractResult<_>>()?;
            let outputs = self.plan.run(inputs)?;
            let array = |output: &TValue| {
                let view = output.to_plain_array_view::<f32>()?;
                Ok(Array::new(view.shape(), view.iter().copied().collect()))
            };
            outputs.iter().map(array).collect::<TractResult<_>>()
        })
    }
}

fn shape(path: &str, problem: String) -> OnnxError {
    OnnxError::Shape { path: path.to_owned(), problem }
}

/// Runs the library, which may refuse in two ways: by an error with its causes, or by a panic.
fn guarded<T, E: Display>(
    path: &str,
    doing: &'static str,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, OnnxError> {
    let failed = |why: String| OnnxError::Compute { path: path.to_owned(), doing, why };
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => done.map_err(|error| failed(format!("{error:#}"))),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
            Err(failed(format!("the library panicked: {}", text.unwrap_or("without a word"))))
        }
    }
}

/// Makes the plan, with inputs and outputs in the order of the caller.
fn prepare(
    onnx: &tract_onnx::Onnx,
    model: &ModelProto,
    folder: &Path,
    inputs: &[Named],
    outputs: &[String],
) -> TractResult<Arc<TypedRunnableModel>> {
    let parsed = onnx.parse(model, folder.to_str())?;
    if let Some(name) = parsed.unresolved_inputs.first() {
        return Err(TractError::msg(format!("nothing makes {name:?}")));
    }
    let mut network = parsed.model;
    let place = |name: &String| parsed.outlets_by_name.get(name).copied();
    let placed = |name: &String| place(name).ok_or_else(|| TractError::msg(format!("{name:?} is nowhere")));
    network.set_input_outlets(&inputs.iter().map(|input| placed(&input.name)).collect::<TractResult<Vec<_>>>()?)?;
    network.select_output_outlets(&outputs.iter().map(placed).collect::<TractResult<Vec<_>>>()?)?;
    for (index, input) in inputs.iter().enumerate() {
        network.set_input_fact(index, f32::fact(&input.shape).into())?;
    }
    network.into_optimized()?.into_runnable()
}

/// Checks that the graph takes these inputs and no others.
fn check_inputs(path: &str, graph: &GraphProto, inputs: &[Named]) -> Result<(), OnnxError> {
    let weights = |name: &str| graph.initializer.iter().any(|tensor| tensor.name == name);
    let taken: Vec<&ValueInfoProto> = graph.input.iter().filter(|input| !weights(&input.name)).collect();
    let names = || taken.iter().map(|input| format!("{:?}", input.name)).collect::<Vec<_>>().join(", ");
    if let Some(left) = taken.iter().find(|taken| inputs.iter().all(|input| input.name != taken.name)) {
        return Err(shape(path, format!("input {:?} is not named by the manifest", left.name)));
    }
    for input in inputs {
        let found = taken.iter().find(|taken| taken.name == input.name);
        let found = found.ok_or_else(|| shape(path, format!("has no input {:?}, it takes {}", input.name, names())))?;
        check_input(found, input).map_err(|problem| shape(path, format!("input {:?} {problem}", input.name)))?;
    }
    Ok(())
}

/// Says what of an input differs from what the manifest gives.
fn check_input(found: &ValueInfoProto, given: &Named) -> Result<(), String> {
    let Some(type_proto::Value::TensorType(tensor)) = found.r#type.as_ref().and_then(|kind| kind.value.as_ref()) else {
        return Err("is no tensor".to_owned());
    };
    if tensor.elem_type != SINGLE {
        return Err(format!("has element type {}, inputs are of single precision (1)", tensor.elem_type));
    }
    let Some(sides) = &tensor.shape else { return Ok(()) };
    let sides: Vec<Option<i64>> = sides.dim.iter().map(fixed).collect();
    let fits = |side: &Option<i64>, given: &usize| side.is_none_or(|side| usize::try_from(side) == Ok(*given));
    if sides.len() == given.shape.len() && sides.iter().zip(&given.shape).all(|(side, given)| fits(side, given)) {
        return Ok(());
    }
    let text = |side: &Option<i64>| side.map_or_else(|| "?".to_owned(), |side| side.to_string());
    let sides = sides.iter().map(text).collect::<Vec<_>>().join(", ");
    Err(format!("has shape [{sides}], the manifest gives {:?}", given.shape))
}

/// `TensorProto.DataType.FLOAT`.
const SINGLE: i32 = 1;

fn fixed(side: &tract_onnx::pb::tensor_shape_proto::Dimension) -> Option<i64> {
    match side.value {
        Some(tract_onnx::pb::tensor_shape_proto::dimension::Value::DimValue(side)) => Some(side),
        _ => None,
    }
}

fn check_outputs(path: &str, graph: &GraphProto, outputs: &[String]) -> Result<(), OnnxError> {
    let names = || graph.output.iter().map(|output| format!("{:?}", output.name)).collect::<Vec<_>>().join(", ");
    match outputs.iter().find(|wanted| graph.output.iter().all(|output| output.name != **wanted)) {
        Some(wanted) => Err(shape(path, format!("has no output {wanted:?}, it gives {}", names()))),
        None => Ok(()),
    }
}

/// Returns the digest of the file and of the files beside it that hold its weights.
fn digest(path: &str, bytes: &[u8], graph: &GraphProto, folder: &Path) -> Result<Digest, OnnxError> {
    let mut writer = DigestWriter::new();
    writer.digest(&Digest::of(bytes));
    let location = |tensor: &TensorProto| {
        let entry = tensor.external_data.iter().find(|entry| entry.key == "location")?;
        Some(entry.value.clone())
    };
    let mut files: Vec<String> = graph.initializer.iter().filter_map(location).collect();
    files.sort();
    files.dedup();
    for file in files {
        let named = Path::new(&file).components().all(|part| matches!(part, std::path::Component::Normal(_)));
        if !named {
            return Err(shape(path, format!("keeps weights in {file:?}, which is not beside it")));
        }
        let there = folder.join(&file);
        let read = std::fs::read(&there);
        let read = read.map_err(|source| OnnxError::Read { path: there.display().to_string(), source })?;
        writer.text(&file).digest(&Digest::of(&read));
    }
    Ok(writer.finish())
}

#[cfg(test)]
mod tests;
