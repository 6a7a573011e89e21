//! Recipes: what they inherit and what is refused.

use ds_nn::{Array, Weights};

use super::*;

#[test]
fn recipes_inherit_table_by_table() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = load(folder.path(), &recipe(folder.path())).expect("valid");
    let arm = folder.path().join("arm.toml");
    let text =
        "inherits = \"train.toml\"\nfolder = \"arm\"\nparent = \"whole\"\n[teacher]\ndropout = [\"layout\", \"all\"]\n";
    std::fs::write(&arm, text).expect("writes");
    let found = TrainConfig::load(&arm).expect("valid");
    let teacher = found.teacher.clone().expect("inherited");
    assert_eq!(teacher.dropout, [crate::guidance::Dropout::Layout, crate::guidance::Dropout::All]);
    assert_eq!(Some(&teacher.stage), base.teacher.as_ref().map(|teacher| &teacher.stage));
    assert_eq!((found.folder.as_path(), found.parent.as_deref()), (Path::new("arm"), Some(Path::new("whole"))));
    std::fs::write(&arm, "inherits = \"arm.toml\"").expect("writes");
    assert!(TrainConfig::load(&arm).expect_err("a ring").to_string().contains("inherit from each other"));
}

#[test]
fn broken_recipes_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = recipe(folder.path());
    let check = |from: &str, to: &str, expected: &str| {
        assert!(good.contains(from), "{from:?}");
        let message = load(folder.path(), &good.replacen(from, to, 1)).map(|_| String::new());
        let message = message.unwrap_or_else(|error| error.to_string());
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check("version = 2", "version = 1", "version");
    check("learning_rate = 3e-3", "learning_rate = -1.0", "autoencoder");
    check("checkpoint_every = 20", "checkpoint_every = 0", "autoencoder");
    check("sets = [\"clips\"]", "sets = [\"clip\"]", "\"clip\" is not among");
    check("clips = 4", "clips = 4\naccumulate = 0", "accumulate must be");
    check("warm_up = 5", "warm_up = 5\nschedule = \"step\"", "cannot be read");
    check("latents = 3", "latents = 3\ncrop_px = [30, 24]", "must be multiples of 8");
    check("sets = [\"broad\"]", "sets = [\"broad\"]\ncrop_px = [32, 24]", "belongs to the autoencoder");
    check("rollout = 4", "rollout = 2", "self_forcing");
    check("reject = 0.2", "reject = 1.0", "trajectories");
    check("crop_px = [32, 24]", "crop_px = [30, 24]", "crop_px");
    check("untold = 0.5", "untold = 2.0", "untold");
    check("share = 0.3", "share = -1.0", "adversarial");
    check("untold = 0.5", "untold = 0.5\ntexture = -1.0", "texture");
    check("seed = 1", "sed = 1", "cannot be read");
    check("dropout = [\"layout\"]", "dropout = [\"layout\"]\ndropped = 1", "cannot be read");
    check("dropout = [\"layout\"]", "dropout = [\"all\"]", "unconditional");
    check("replay = [\"broad\"]", "replay = [\"clip\"]", "\"clip\" is not among");
    check("trunk_rate = 0.8", "trunk_rate = 2.0", "trunk_rate");
    check("seed = 1", "seed = 1\nguide_levels = [0.8, 0.2]", "guide_levels");
    let standard = "seed = 1\nkeep_look = true\nunconditional = \"all\"";
    check("seed = 1", standard, "unconditional");
    assert!(
        load(folder.path(), &good.replacen("seed = 1", standard, 1).replace("[\"layout\"]", "[\"all\"]"))
            .is_err_and(|error| error.to_string().contains("keep_look"))
    );
    check("dropout = [\"layout\"]", "dropout = [\"layout\"]\ndropout_share = 1.0", "dropout_share");
}

#[test]
fn the_learning_rate_rises_then_goes_its_way() {
    let folder = tempfile::tempdir().expect("a folder");
    let check = |schedule: &str, expected: [f32; 5]| {
        let text = recipe(folder.path()).replacen("warm_up = 5", &format!("warm_up = 10\n{schedule}"), 1);
        let text = text.replacen("steps = 60", "steps = 110", 1).replacen("3e-3", "0.1", 1);
        let stage = load(folder.path(), &text).expect("valid").autoencoder.expect("a stage");
        let found = [0, 9, 10, 35, 110].map(|step| stage.rate(step));
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{schedule}: {found:?}");
    };
    let cosine = [0.01, 0.1, 0.1, 0.1 * (0.1 + 0.45 * (1.0 + std::f32::consts::FRAC_1_SQRT_2)), 0.01];
    check("", cosine);
    check("schedule = \"cosine\"", cosine);
    check("schedule = \"linear\"", [0.01, 0.1, 0.1, 0.0775, 0.01]);
    check("schedule = \"constant\"", [0.01, 0.1, 0.1, 0.1, 0.1]);
}

#[test]
fn clips_with_noise_have_no_estimate_to_cache() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = recipe(folder.path()).replacen("seed = 1", "seed = 1\ncache_source = \"x0hat(1)\"", 1);
    let text = text.replacen(
        "source = \"trajectories\"\nstage = { sets = []",
        "source = \"data\"\nfrom_teacher = false\nstage = { sets = [\"clips\"]",
        1,
    );
    let config = load(folder.path(), &text).expect("valid");
    let error = Stage::Ode.run(&config, &mut Silent).expect_err("no estimate");
    assert!(error.to_string().contains("x0hat(j)"), "{error}");
}

#[test]
fn a_decoder_that_ships_is_averaged_with_the_one_that_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = recipe(folder.path()).replace("seed = 1\n", "seed = 1\naveraged_with = \"other.safetensors\"\n");
    let config = load(folder.path(), &text).expect("valid");
    let weights = |first: f32| {
        let mut weights = Weights::default();
        weights.insert("decoder.out", Array::new(&[2], vec![first, 1.0]));
        weights
    };
    let mut file = WeightsFile::default();
    file.weights.absorb("vae.", &weights(3.0));
    file.write(&folder.path().join("other.safetensors")).expect("writes");
    let mean = config.averaged(weights(1.0)).expect("averages");
    assert_eq!(mean.get("decoder.out").map(Array::values), Some([2.0, 1.0].as_slice()));
    let mut other = weights(1.0);
    other.insert("decoder.in", Array::new(&[1], vec![0.0]));
    let error = config.averaged(other).expect_err("another network").to_string();
    assert!(error.contains("averaged_with"), "{error}");
}
