//! Small random networks of diffusers and transformers give the same outputs here, from their names and from Wan's.
//!
//! Runs when `DREAMSTREAM_SLOW_TESTS` is set. The first run makes an environment of Python under `target`, a download
//! of some gigabytes; `DREAMSTREAM_PARITY_PYTHON` names an interpreter that has the packages already. What the packages
//! compute is made by `made/parity.py`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use ds_graph::device::Precision;
use ds_graph::dit::{Clip, Dit};
use ds_graph::published::clip::{Clip as ImageEncoder, ClipShape};
use ds_graph::published::tae::{self, Tae, TaeMemory};
use ds_graph::published::umt5::{Umt5, Umt5Shape};
use ds_graph::published::wan_vae::{WanMemory, WanVae, WanVaeShape};
use ds_nn::Array;
use ds_nn::checkpoint::{Checkpoint, Finite, Naming};
use ds_nn::dit::{DitShape, Gelu};
use ds_nn::sentencepiece::Tokeniser;

const PACKAGES: [&str; 5] = ["torch", "diffusers==0.42.1", "transformers==5.23.0", "safetensors", "sentencepiece"];
const MAX_DIFFERENCE: f32 = 1e-4;

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

fn skipped(why: &str) -> Option<PathBuf> {
    assert!(std::env::var_os("DREAMSTREAM_REQUIRE_PYTHON").is_none(), "parity is required here: {why}");
    eprintln!("skipped: {why}");
    None
}

/// Returns an interpreter with the packages, which the first call installs.
fn python() -> Option<PathBuf> {
    if let Some(python) = std::env::var_os("DREAMSTREAM_PARITY_PYTHON") {
        return Some(PathBuf::from(python));
    }
    let folder = workspace().join("target/parity-python");
    let (python, stamp) = (folder.join("bin/python"), folder.join("ready"));
    if stamp.exists() {
        return Some(python);
    }
    eprintln!("making {}, this downloads some gigabytes once", folder.display());
    let made = Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder).output();
    if !made.is_ok_and(|output| output.status.success()) {
        return skipped("python3 -m venv does not work");
    }
    let installed = Command::new(&python).args(["-m", "pip", "install", "-q"]).args(PACKAGES).output();
    let installed = installed.expect("the interpreter was just made");
    if !installed.status.success() {
        let fault = String::from_utf8_lossy(&installed.stderr);
        let last = fault.lines().last().unwrap_or("no reason given");
        return skipped(&format!("the packages cannot be installed, is there a network? {last}"));
    }
    std::fs::write(&stamp, "").expect("a stamp");
    Some(python)
}

/// Returns the folder of the packages' answers, made once per run.
fn answers() -> Option<&'static Path> {
    static FOLDER: OnceLock<Option<PathBuf>> = OnceLock::new();
    let make = || {
        if std::env::var_os("DREAMSTREAM_SLOW_TESTS").is_none() {
            eprintln!("skipped: DREAMSTREAM_SLOW_TESTS is not set");
            return None;
        }
        let python = python()?;
        let folder = workspace().join("target/parity");
        let script = workspace().join("crates/learn/graph/tests/made/parity.py");
        let output = Command::new(python).arg(script).arg(&folder).env("HF_HUB_OFFLINE", "1").output();
        let output = output.expect("the interpreter runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Some(folder)
    };
    FOLDER.get_or_init(make).as_deref()
}

/// Inputs and outputs of a case.
struct Case {
    folder: &'static Path,
    name: &'static str,
    values: Checkpoint,
}

impl Case {
    fn open(name: &'static str) -> Option<Self> {
        let folder = answers()?;
        let values = Checkpoint::open(&folder.join(format!("{name}.io.safetensors"))).expect("inputs and outputs");
        Some(Self { folder, name, values })
    }

    fn array(&self, name: &str) -> Array {
        self.values.read(name).expect(name)
    }

    /// The weights by the library's names and by those of the published checkpoints.
    fn files(&self) -> [Checkpoint; 2] {
        ["", ".native"].map(|kind| self.file(&format!("{}{kind}.safetensors", self.name)))
    }

    fn file(&self, name: &str) -> Checkpoint {
        Checkpoint::open(&self.folder.join(name)).expect(name)
    }

    fn compare(&self, what: &str, found: &Array, expected: &str) {
        let expected = self.array(expected);
        assert_eq!(found.shape(), expected.shape(), "{} {what}", self.name);
        let pairs = found.values().iter().zip(expected.values());
        let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let scale = expected.values().iter().map(|value| value.abs()).fold(0.0, f32::max);
        eprintln!("{:<8} {what:<24} largest difference {largest:.2e} of values up to {scale:.2}", self.name);
        assert!(largest <= MAX_DIFFERENCE, "{} {what}: {largest}", self.name);
    }
}

fn shape() -> DitShape {
    DitShape {
        layers: 2,
        dim: 64,
        heads: 2,
        ffn: 96,
        latent_channels: 16,
        control_inputs: 0,
        control_channels: 0,
        start_channels: 0,
        freq_dim: 256,
        text_dim: 24,
        text_len: 512,
        image_context: false,
        clip_dim: 0,
        reference: false,
        gelu: Gelu::Tanh,
        start_every: false,
        cross_every: 1,
        grid_h: 3,
        grid_w: 4,
    }
}

/// The channels of an array with 48 of them, in thirds.
fn thirds(array: &Array) -> [Array; 3] {
    let [frames, n, pixels, channels]: [usize; 4] = array.shape().try_into().expect("four axes");
    let part = |index: usize| {
        let of = |pixel: &[f32]| pixel[index * channels / 3..(index + 1) * channels / 3].to_vec();
        Array::new(&[frames, n, pixels, channels / 3], array.values().chunks(channels).flat_map(of).collect())
    };
    [part(0), part(1), part(2)]
}

fn transformer(case: &Case, shape: &DitShape, file: &Checkpoint, what: &str) {
    let fitted = file.fit(&shape.declare(), Naming::Transformer).expect("fits");
    let dit = Dit::load(shape, &fitted, Finite::Checked, Precision::F32).expect("loads");
    let (x, times) = (case.array("x"), case.array("times"));
    let first = if shape.clip_dim > 0 { case.array("states") } else { Array::zeros(&[1, 1, 1]) };
    let context = dit.context(&case.array("text"), &first);
    let split = (shape.control_channels > 0).then(|| thirds(&x));
    let clip = match &split {
        Some([noisy, control, start]) => {
            Clip { noisy, control: Some(control), start: Some(start), reference: None, times: times.values() }
        }
        None => Clip { noisy: &x, control: None, start: None, reference: None, times: times.values() },
    };
    case.compare(what, &dit.whole(&clip, &context), "output");
}

#[test]
fn the_transformer_is_that_of_diffusers() {
    for (name, shape) in [
        ("text", shape()),
        ("frames", shape()),
        ("control", DitShape { control_channels: 16, start_channels: 16, clip_dim: 40, ..shape() }),
    ] {
        let Some(case) = Case::open(name) else { return };
        let [foreign, native] = case.files();
        transformer(&case, &shape, &foreign, "by names of diffusers");
        transformer(&case, &shape, &native, "by names of Wan");
        if name == "text" {
            transformer(&case, &shape, &case.file("transformer.pth"), "from an archive");
        }
    }
}

#[test]
fn the_autoencoders_are_those_of_diffusers() {
    for (name, shape, naming) in [
        ("vae21", WanVaeShape { z: 4, encoder_width: 8, decoder_width: 8, folded: false }, Naming::Vae21),
        ("vae22", WanVaeShape { z: 6, encoder_width: 8, decoder_width: 12, folded: true }, Naming::Vae22),
    ] {
        let Some(case) = Case::open(name) else { return };
        for (file, kind) in case.files().iter().zip(["diffusers", "Wan"]) {
            let fitted = file.fit(&shape.declare(), naming).expect("fits");
            let vae = WanVae::load(&shape, &fitted, Finite::Checked, Precision::F32).expect("loads");
            let means = vae.encode(&case.array("frames"), &mut WanMemory::default());
            case.compare(&format!("encoder, names of {kind}"), &means, "means");
            let decoded = vae.decode(&case.array("latents"), &mut WanMemory::default());
            case.compare(&format!("decoder, names of {kind}"), &decoded, "decoded");
        }
    }
}

#[test]
fn the_text_encoder_is_that_of_transformers() {
    let shape =
        Umt5Shape { vocabulary: 100, dim: 32, attention: 32, heads: 4, ffn: 48, layers: 2, buckets: 32, far: 128 };
    let Some(case) = Case::open("umt5") else { return };
    for (file, kind) in case.files().into_iter().zip(["transformers", "Wan"]) {
        let encoder = Umt5::load(&shape, file, Finite::Checked, Precision::F32).expect("loads");
        let tokens: Vec<u32> = case.array("ids").values().iter().map(|id| *id as u32).collect();
        let states = encoder.states(&tokens, 220).expect("reads its table");
        case.compare(&format!("names of {kind}"), &states, "states");
    }
}

#[test]
fn the_image_encoder_is_that_of_transformers() {
    let shape = ClipShape { image: 56, patch: 14, dim: 64, heads: 4, ffn: 96, layers: 3 };
    let Some(case) = Case::open("clip") else { return };
    for (file, kind) in case.files().iter().zip(["transformers", "Wan"]) {
        let fitted = file.fit(&shape.declare(), Naming::Clip).expect("fits");
        let encoder = ImageEncoder::load(&shape, &fitted, Finite::Checked, Precision::F32).expect("loads");
        case.compare(&format!("names of {kind}"), &encoder.states(&case.array("image")), "states");
    }
}

#[test]
fn the_tiny_autoencoder_is_the_one_described() {
    let Some(case) = Case::open("tae") else { return };
    let [file, _] = case.files();
    let tae = Tae::load(&file.fit(&tae::declare(), Naming::Plain).expect("fits"), Finite::Checked).expect("loads");
    case.compare("encoder", &tae.encode(&case.array("frames"), &mut TaeMemory::default()), "encoded");
    case.compare("decoder", &tae.decode(&case.array("latents"), &mut TaeMemory::default()), "decoded");
}

/// The texts of `parity.py`.
const TEXTS: [&str; 6] = [
    "A wet road at night, with two cars ahead.",
    "  many   spaces \n and lines ",
    "\u{ff21}\u{ff42}\u{ff43} \u{fb01}ne \u{bd} caf\u{e9} na\u{ef}ve \u{2460}",
    "\u{591c}\u{306e}\u{9053}\u{8def}\u{3001}\u{96e8}",
    "emoji \u{1f697} in between",
    "",
];

#[test]
fn tokens_are_those_of_sentencepiece() {
    let Some(case) = Case::open("tokens") else { return };
    for name in ["bytes", "plain"] {
        let tokeniser = Tokeniser::load(&case.folder.join(format!("{name}.model"))).expect("a model");
        for (index, text) in TEXTS.iter().enumerate() {
            let expected: Vec<u32> =
                case.array(&format!("{name}.{index}")).values().iter().map(|token| *token as u32).collect();
            assert_eq!(tokeniser.tokens(text, 512), expected, "{name}, {text:?}");
        }
    }
}
