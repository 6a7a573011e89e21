//! The same equivalences for published models: smallest sizes, drawn weights saved under the published names.

use std::path::Path;

use ds_graph::published::clip::ClipShape;
use ds_graph::published::tae;
use ds_graph::published::wan_vae::{WanMemory, WanVae};
use ds_nn::Declared;
use ds_nn::safetensors::WeightsFile;

use super::*;
use crate::tokens;

const WAN: &str = include_str!("../../../../../configs/models/wan-smoke.toml");
const CHUNK: u32 = 12;
const FILES: &str = "transformer = \"dit.safetensors\"\nvae = \"vae.safetensors\"\ntext = \"text.safetensors\"
tokeniser = \"spiece.model\"\nimage = \"clip.safetensors\"\n";

/// Writes the files that a configuration names to a folder.
fn files(config: &ModelConfig) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let weights = &config.weights;
    let vae = config.wan_vae().expect("published").declare();
    for (name, declared) in [
        (&weights.transformer, config.dit().declare()),
        (&weights.vae, vae),
        (&weights.decoder, tae::declare()),
        (&weights.text, config.umt5().declare()),
        (&weights.image, config.clip().declare()),
    ] {
        if !name.as_os_str().is_empty() {
            write(&folder.path().join(name), &declared, |_| ());
        }
    }
    std::fs::write(folder.path().join(&weights.tokeniser), tokeniser()).expect("writes");
    folder
}

fn write(path: &Path, declared: &[Declared], change: impl FnOnce(&mut Weights)) {
    let mut weights = Weights::initialised(declared, &Digest::of(b"published"));
    change(&mut weights);
    WeightsFile { weights, ..WeightsFile::default() }.write(path).expect("writes");
}

/// A model of sentencepiece: the end, the unknown, a space and single letters.
fn tokeniser() -> Vec<u8> {
    let field = |number: u8, bytes: &[u8]| [&[number << 3 | 2, bytes.len() as u8], bytes].concat();
    let piece = |text: &str, kind: u8| {
        let score = [&[2 << 3 | 5], &(-1.0f32).to_le_bytes()[..]].concat();
        field(1, &[field(1, text.as_bytes()), score, vec![3 << 3, kind]].concat())
    };
    let letters = "▁abdeghiklnrsty".chars().map(|letter| piece(&letter.to_string(), 1));
    [piece("</s>", 3), piece("<unk>", 2)].into_iter().chain(letters).flatten().collect()
}

/// The preset with files.
fn config() -> ModelConfig {
    ModelConfig::parse(&WAN.replace("drawn = true\n", FILES)).expect("the preset is valid")
}

/// The preset with the tiny decoder.
fn tiny() -> ModelConfig {
    let mut config = config();
    config.vae.kind = "taew21".to_owned();
    config.weights.decoder = "tae.safetensors".into();
    config
}

/// The preset without a path for layouts and without CLIP.
fn plain() -> ModelConfig {
    let mut config = config();
    config.control = crate::config::ControlConfig { encoder: "none".to_owned(), channels: 0, ..config.control };
    config.model = crate::config::DitConfig {
        in_dim: 16,
        start: crate::config::StartConfig::None,
        clip_dim: 0,
        img_tokens: 0,
        reference: false,
        ..config.model
    };
    config.weights.image = std::path::PathBuf::new();
    config
}

fn opened(config: &ModelConfig) -> Arc<VideoModel> {
    let loaded = VideoModel::load_on(Backend::Framework, config, files(config).path());
    Arc::new(loaded.unwrap_or_else(|error| panic!("{}", told(&error))))
}

/// Returns the text of an error and of its sources.
fn told(error: &dyn std::error::Error) -> String {
    error.source().map_or_else(|| error.to_string(), |source| format!("{error}: {}", told(source)))
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_partial_chunk_is_made_again_and_whole_ones_do_not_depend_on_the_split() {
    for config in [config(), tiny(), plain()] {
        let model = opened(&config);
        let exact = start(&model).0.generate(&layouts(1..25)).expect("generates");
        assert_eq!((exact.frames.len(), exact.committed.len(), exact.seam), (24, 2, 0.0));
        let mut rollout = start(&model).0;
        let (mut frames, mut committed) = (Vec::new(), Vec::new());
        for part in [1..6, 6..11, 11..16, 16..21, 21..25] {
            let count = part.len();
            let generated = rollout.generate(&layouts(part)).expect("generates");
            assert_eq!(generated.frames.len(), count);
            frames.extend(generated.frames);
            committed.extend(generated.committed);
        }
        assert_eq!(committed, exact.committed, "{}", config.vae.kind);
        // Ticks that complete a chunk are made with its true layouts.
        assert_eq!((&frames[10..12], &frames[20..]), (&exact.frames[10..12], &exact.frames[20..]));
    }
}

#[test]
fn a_copy_of_a_published_rollout_continues_to_the_bit() {
    let model = opened(&tiny());
    let mut rollout = start(&model).0;
    rollout.generate(&layouts(1..16)).expect("generates");
    let mut copy = rollout.clone();
    let on = |rollout: &mut Rollout| {
        let generated = rollout.generate(&layouts(16..30)).expect("generates");
        (generated.frames, generated.committed, rollout.state_digest())
    };
    let expected = on(&mut rollout);
    rollout.generate(&layouts(50..60)).expect("generates");
    assert_eq!(on(&mut copy), expected);
}

#[test]
fn a_successor_of_a_published_model_gives_the_same_frames() {
    let model = opened(&config());
    let remembered = model.config().layout_memory_ticks() as u32;
    // At the start, in mid-chunk, and beyond what is remembered of layouts.
    for (done, since) in [(0, 0), (1, 5), (13, 2)] {
        let (mut rollout, entry) = start(&model);
        let (last, ticks) = (CHUNK * done, CHUNK * done + since);
        assert_eq!(last > remembered, done > 11);
        let mut log = vec![entry];
        if ticks > 0 {
            log.extend(rollout.generate(&layouts(1..ticks + 1)).expect("generates").committed);
        }
        let replay = |past: &[RgbImage]| {
            let [past, since] =
                [past, &layouts(last + 1..ticks + 1)[..]].map(|all| all.iter().map(Layout::from).collect::<Vec<_>>());
            let key = Digest::of(b"key");
            Rollout::replay(Replay {
                model: Arc::clone(&model),
                draw_key: key,
                camera: "front",
                prompt: PROMPT,
                first_frame: &picture(0),
                entries: &log,
                past: &past,
                layouts: &since,
            })
        };
        let past = layouts(last.saturating_sub(remembered)..last + 1);
        let mut successor = replay(&past).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(successor.state_digest(), rollout.state_digest());
        let next = layouts(ticks + 1..ticks + 26);
        let (a, b) = (rollout.generate(&next).expect("generates"), successor.generate(&next).expect("generates"));
        assert_eq!((a.frames, a.committed, a.seam), (b.frames, b.committed, b.seam), "{done}, {since}");
        assert!(matches!(replay(&past[1..]), Err(VideoError::Remembered { .. })));
        let mut other = past.clone();
        *other.last_mut().expect("there is one") = picture(7);
        assert!(matches!(replay(&other), Err(VideoError::RecoveryMismatch { what: "control", .. })));
    }
}

#[test]
fn a_rollout_encodes_and_decodes_as_a_whole_clip() {
    let config = config();
    let model = opened(&config);
    let (mut rollout, first) = start(&model);
    let generated = rollout.generate(&layouts(1..37)).expect("generates");
    let joined = |part: fn(&Cache) -> &Tensor| -> Vec<f32> {
        std::iter::once(&first).chain(&generated.committed).flat_map(|entry| part(entry).values.clone()).collect()
    };
    let shape = config.wan_vae().expect("published");
    let weights = Weights::initialised(&shape.declare(), &Digest::of(b"published"));
    let vae = WanVae::new(&shape, &weights).expect("fits");
    let video: Vec<RgbImage> = layouts(0..37).iter().map(|layout| layout.resized(32, 16)).collect();
    let whole = vae.encode(&tokens::stacked(&video.iter().collect::<Vec<_>>()), &mut WanMemory::default());
    let control = tokens::latents_to_tokens(&model.normalised(whole));
    assert!(difference(control.values(), &joined(|entry| &entry.control)) < 1e-4);
    let clean = Array::new(&[10, 2, 4, 16], joined(|entry| &entry.clean));
    let latents = model.denormalised(tokens::tokens_to_latents(&clean, 2, 4));
    let decoded = vae.decode(&latents, &mut WanMemory::default());
    let frames: Vec<RgbImage> = decoded.values()[16 * 32 * 3..]
        .chunks_exact(16 * 32 * 3)
        .map(|values| RgbImage::of_values(values, 32, 16))
        .collect();
    let pairs = frames.iter().zip(&generated.frames).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    assert!(frames.len() == 36 && pairs.into_iter().all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn a_published_model_heeds_prompt_first_frame_and_layouts() {
    let model = opened(&config());
    let run = |prompt: &str, first: u32, on: u32| {
        let begun =
            Rollout::new(Arc::clone(&model), Digest::of(b"key"), "front", prompt, &picture(first), picture(100));
        begun.expect("starts").0.generate(&layouts(on..on + 12)).expect("generates").committed.remove(0).clean
    };
    let base = run(PROMPT, 0, 1);
    assert_eq!(run(PROMPT, 0, 1), base);
    for other in [run("night", 0, 1), run(PROMPT, 5, 1), run(PROMPT, 0, 3)] {
        assert_ne!(other, base);
    }
}

#[test]
fn half_precision_rolls_on() {
    let mut config = tiny();
    config.precision.linear = crate::config::FormatConfig::Bf16;
    config.precision.vae_decode = crate::config::FormatConfig::Bf16;
    let model = opened(&config);
    assert_eq!(start(&model).0.generate(&layouts(1..14)).expect("finite").frames.len(), 13);
}

#[test]
fn drawn_weights_are_asked_for_by_name() {
    let drawn = ModelConfig::parse(WAN).expect("valid");
    let nowhere = Path::new("/nowhere");
    let model = VideoModel::load_on(Backend::Framework, &drawn, nowhere).expect("no file is read");
    assert_ne!(model.digest(), opened(&config()).digest());
    let frames = start(&Arc::new(model)).0.generate(&layouts(1..13)).expect("generates").frames;
    assert_eq!(frames.len(), 12);
    let error = VideoModel::load_on(Backend::Framework, &config(), nowhere).err().expect("no files");
    assert!(told(&error).contains("/nowhere/dit.safetensors"), "{}", told(&error));
}

#[test]
fn files_of_a_published_model_are_refused_by_tensor() {
    let base = config();
    let files = files(&tiny());
    let folder = files.path();
    let check = |config: &ModelConfig, expected: [&str; 2]| {
        let error = VideoModel::load_on(Backend::Framework, config, folder).err().expect(expected[1]);
        let text = told(&error);
        assert!(expected.iter().all(|part| text.contains(part)), "{text:?} lacks one of {expected:?}");
    };
    let spoiled = |name: &str, declared: &[Declared], change: fn(&mut Weights)| {
        write(&folder.join(name), declared, change);
        std::path::PathBuf::from(name)
    };
    let mut config = base.clone();
    config.weights.transformer =
        spoiled("dropped.safetensors", &base.dit().declare(), |w| drop(w.remove("blocks.1.cross_attn.k_img.bias")));
    check(&config, ["weights.transformer", "\"blocks.1.cross_attn.k_img.bias\" is missing"]);
    let mut config = base.clone();
    config.weights.vae = spoiled("transposed.safetensors", &base.wan_vae().expect("published").declare(), |w| {
        w.insert("decoder.conv1.weight", Array::zeros(&[16, 16, 1, 3, 3]));
    });
    check(&config, ["weights.vae", "\"decoder.conv1.weight\" has shape [16, 16, 1, 3, 3]"]);
    let mut config = base.clone();
    config.weights.text = spoiled("nan.safetensors", &base.umt5().declare(), |w| {
        w.get_mut("blocks.0.ffn.fc1.weight").expect("there").values_mut()[3] = f32::NAN;
    });
    check(&config, ["weights.text", "\"blocks.0.ffn.fc1.weight\" holds NaN at index 3"]);
    let mut config = base.clone();
    config.weights.image = spoiled("extra.safetensors", &ClipShape { layers: 4, ..base.clip() }.declare(), |_| ());
    check(&config, ["weights.image", "\"visual.transformer.3"]);
    let mut config = tiny();
    config.weights.decoder = base.weights.vae.clone();
    check(&config, ["weights.decoder", "is missing"]);
    let mut config = base.clone();
    config.text_encoder.vocabulary = 16;
    config.weights.text = spoiled("few.safetensors", &config.umt5().declare(), |_| ());
    check(&config, ["weights.tokeniser has 17 tokens", "vocabulary is 16"]);
    let mut config = base.clone();
    config.weights.text = std::path::PathBuf::new();
    check(&config, ["\"weights.text\" is empty", "needs a file here"]);
    let error = VideoModel::load(&base, folder).err().expect("the processor's own path");
    assert!(told(&error).contains("back end \"cpu\""), "{}", told(&error));
}
