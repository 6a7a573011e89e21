//! Every rule of a model configuration, broken one at a time.

use super::*;

const SMOKE: &str = include_str!("../../../../configs/models/smoke.toml");

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
    check(("stride_t = 4", "stride_t = 3"), "vae.stride_t");
    check(("dim = 64", "dim = 99999999"), "sizes must be");
    check(("version = 1", "version = 2"), "version");
    check(("steps = 2", "steps = 2\nstep = 3"), "unknown field");
    check(("shift = 5.0", "shift = nan"), "sampler.steps");
}

#[test]
fn all_presets_are_valid() {
    for text in [
        SMOKE,
        include_str!("../../../../configs/models/cpu_train.toml"),
        include_str!("../../../../configs/models/embedded.toml"),
    ] {
        let config = ModelConfig::parse(text).expect("a preset is valid");
        assert_eq!(ModelConfig::parse(&toml::to_string(&config).expect("it came from TOML")).expect("valid"), config);
    }
}
