//! Every rule of a model configuration, broken one at a time.

use super::*;

const SMOKE: &str = include_str!("../../../../../configs/models/smoke.toml");

const WAN: &str = include_str!("../../../../../configs/models/wan2.1-1.3b.toml");
const FUN: &str = include_str!("../../../../../configs/models/wan2.1-fun-1.3b-control.toml");
const LARGE: &str = include_str!("../../../../../configs/models/wan2.2-5b.toml");

const WAN_SMOKE: &str = include_str!("../../../../../configs/models/wan-smoke.toml");

fn check(input: (&str, &str), expected: &str) {
    assert!(SMOKE.contains(input.0), "the preset holds {:?}", input.0);
    let text = SMOKE.replace(input.0, input.1);
    let message = match ModelConfig::parse(&text) {
        Ok(_) => "accepted".to_owned(),
        Err(ConfigError::Syntax(error)) => error.message().to_owned(),
        Err(error) => error.to_string(),
    };
    assert!(message.contains(expected), "{input:?}: {message:?} lacks {expected:?}");
}

#[test]
fn broken_rules_are_named() {
    check(("heads = 2", "heads = 3"), "model.heads");
    check(("heads = 2", "heads = 0"), "sizes must be");
    check(("heads = 2", "heads = 8"), "model.heads");
    check(("width_px = 64", "width_px = 72"), "video.width_px");
    check(("height_px = 32", "height_px = 1000000"), "video.height_px");
    check(("window = 4", "window = 1"), "causal.window");
    check(("state(2)", "state(1)"), "causal.cache_source");
    check(("state(2)", "state(3)"), "causal.cache_source");
    check(("state(2)", "x0hat(2)"), "causal.cache_source");
    check(("state(2)", "renoise(1.5)"), "causal.cache_source");
    check(("state(2)", "renoise(NaN)"), "causal.cache_source");
    check(("state(2)", "exec(1)"), "causal.cache_source");
    check(("kind = \"tiny\"", "kind = \"wan21\""), "vae.kind");
    check(("kind = \"tiny\"", "kind = \"large\""), "vae.kind");
    check(("stride_t = 4", "stride_t = 3"), "vae.stride_t");
    check(("dim = 64", "dim = 99999999"), "sizes must be");
    check(("version = 1", "version = 2"), "version");
    check(("steps = 2", "steps = 2\nstep = 3"), "unknown field");
    check(("shift = 5.0", "shift = nan"), "sampler.steps");
    check(("encoder_width = 24", "encoder_width = 24\nwidth = 4"), "vae.width");
    check(("encoder_width = 24", "encoder_widths = [8, 16, 24]"), "vae.encoder_blocks");
    check(("encoder_width = 24", "encoder_width = 24\nencoder_widths = [8, 16, 24]"), "vae.encoder_width");
    check(
        ("encoder_width = 24\nencoder_blocks = 1", "encoder_widths = [8, 16, 24]\nencoder_blocks = [1, 1, 99]"),
        "at most 16",
    );
    check(("encoder_blocks = 1", "encoder_blocks = [1, 1, 1]"), "vae.encoder_blocks");
    check(("encoder_blocks = 1", "encoder_blocks = [1, 1]"), "three in brackets");
    check(("first_frame_independent = true", "first_frame_independent = true\n[weights]\nvae = \"a\""), "weights");
}

#[test]
fn all_presets_are_valid() {
    for text in [
        SMOKE,
        include_str!("../../../../../configs/models/cpu_train.toml"),
        include_str!("../../../../../configs/models/embedded.toml"),
        include_str!("../../../../../configs/models/road.toml"),
        WAN,
        FUN,
        LARGE,
        include_str!("../../../../../configs/models/wan-tiny.toml"),
        WAN_SMOKE,
    ] {
        let config = ModelConfig::parse(text).expect("a preset is valid");
        assert_eq!(ModelConfig::parse(&toml::to_string(&config).expect("it came from TOML")).expect("valid"), config);
    }
}

#[test]
fn published_presets_ask_for_the_published_weights() {
    for (text, tensors, parameters, tokens) in
        [(WAN, 825, 1_418_996_800, 1560), (FUN, 985, 1_564_602_176, 1560), (LARGE, 825, 4_999_787_712, 880)]
    {
        let shape = ModelConfig::parse(text).expect("a preset is valid").dit();
        let declared = shape.declare();
        let values: usize = declared.iter().map(|weight| weight.shape.iter().product::<usize>()).sum();
        assert_eq!((declared.len(), values, shape.tokens()), (tensors, parameters, tokens));
    }
}

#[test]
fn broken_rules_of_published_models_are_named() {
    let check = |from: &str, to: &str, expected: &str| {
        assert!(FUN.contains(from), "the preset holds {from:?}");
        let error = ModelConfig::parse(&FUN.replace(from, to)).expect_err(from).to_string();
        assert!(error.contains(expected), "{from:?}: {error:?} lacks {expected:?}");
    };
    check("kind = \"wan21\"", "kind = \"wan22\"", "vae.kind");
    check("kind = \"wan21\"", "kind = \"wan23\"", "must be \"tiny\"");
    check("in_dim = 48", "in_dim = 36", "model.in_dim");
    check("encoder = \"vae\"", "encoder = \"unshuffle\"", "control.encoder");
    check("img_tokens = 257", "img_tokens = 256", "model.img_tokens");
    check("stride_s = 8", "stride_s = 0", "vae.kind");
    check("stride_s = 8", "stride_s = 8\nencoder_width = 4", "vae.encoder_width");
    check("[weights]", "[weights]\ndecoder = \"taew2_1.pth\"", "weights.decoder");
    check(
        "[weights]",
        "[image_encoder]\nimage_px = 28\npatch_px = 14\nheads = 2\nffn = 32\nlayers = 3\n[weights]",
        "img_tokens",
    );
}

#[test]
fn places_of_files_are_not_part_of_the_digest() {
    let digest = |text: &str| ModelConfig::parse(text).expect("valid").digest();
    assert_eq!(digest(FUN), digest(&FUN.replace("Wan2.1_VAE.pth", "elsewhere/vae.pth")));
    assert_ne!(digest(FUN), digest(&FUN.replace("[weights]", "[weights]\ndrawn = true")));
    let config = ModelConfig::parse(FUN).expect("valid");
    assert_eq!(config.weights_beside("a/wan2.1-fun.toml".as_ref()), std::path::Path::new("a/wan2.1-fun"));
    let own = ModelConfig::parse(SMOKE).expect("valid");
    assert_eq!(own.weights_beside("a/smoke.toml".as_ref()), std::path::Path::new("a/smoke.safetensors"));
    assert_eq!((own.layout_memory_ticks(), config.layout_memory_ticks()), (0, 132));
}

#[test]
fn later_fields_leave_the_digest_of_older_presets_alone() {
    let text = toml::to_string(&ModelConfig::parse(SMOKE).expect("valid")).expect("it came from TOML");
    for key in ["encoder_widths", "clip_dim", "reference", "gelu", "precision", "weights", "_encoder]", "\nwidth ="] {
        assert!(!text.contains(key), "{key:?} is part of the digest of weights that were trained before it");
    }
}
