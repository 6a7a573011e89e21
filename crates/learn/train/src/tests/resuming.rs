//! Stages that go on: from a stop to the same bits, never with another recipe.

use super::*;

#[test]
fn a_stopped_run_ends_as_one_that_was_not() {
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    // Fewer steps than the recipe's.
    let fewer = |folder: &Path| {
        let text = recipe(folder).replace("steps = 60", "steps = 6").replace("steps = 80", "steps = 6");
        text.replace("steps = 40", "steps = 6").replace("steps = 10", "steps = 6")
    };
    let whole = load(a.path(), &fewer(a.path())).expect("valid");
    let parts = load(b.path(), &fewer(b.path())).expect("valid");
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Ship) {
        stage.run(&whole, &mut Silent).expect("trains");
        stage.run(&parts, &mut StopAt(3, 0)).expect("trains");
        stage.run(&parts, &mut Silent).expect("resumes");
        if stage != Stage::Trajectories {
            let name = stage.name().replace('-', "_");
            assert_eq!(weights(&whole, &name).digest(), weights(&parts, &name).digest(), "{name}");
        }
    }
}

#[test]
fn trajectories_of_another_teacher_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = recipe(folder.path()).replace("steps = 60", "steps = 2").replace("steps = 80", "steps = 2");
    let config = load(folder.path(), &text.replace("count = 8", "count = 2")).expect("valid");
    for stage in [Stage::Autoencoder, Stage::Teacher, Stage::Trajectories] {
        stage.run(&config, &mut Silent).expect("runs");
    }
    let again = load(folder.path(), &text.replace("guidance = 1.5\nreject", "guidance = 3.0\nreject")).expect("valid");
    let error = Stage::Trajectories.run(&again, &mut Silent).expect_err("another guidance");
    assert!(error.to_string().contains("another recipe or teacher"), "{error}");
}

/// A recipe whose autoencoder takes six steps, a checkpoint after each.
fn six_steps(folder: &Path) -> String {
    recipe(folder).replacen("steps = 60", "steps = 6", 1).replacen("checkpoint_every = 20", "checkpoint_every = 1", 1)
}

#[test]
fn another_recipe_does_not_go_on_from_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = six_steps(folder.path());
    let config = load(folder.path(), &text).expect("valid");
    Stage::Autoencoder.run(&config, &mut StopAt(3, 0)).expect("trains");
    let check = |from: &str, to: &str, expected: &[&str]| {
        assert!(text.contains(from), "{from:?}");
        let config = load(folder.path(), &text.replacen(from, to, 1)).expect("valid");
        let error = Stage::Autoencoder.run(&config, &mut StopAt(3, 0)).expect_err("another recipe");
        assert!(matches!(error, TrainError::Recipe { .. }), "{error}");
        let message = error.to_string();
        assert!(expected.iter().all(|part| message.contains(part)), "{message:?} lacks one of {expected:?}");
    };
    check("learning_rate = 3e-3", "learning_rate = 1e-3", &["autoencoder.learning_rate", "0.003", "0.001", "remove"]);
    check("clips = 4", "clips = 2", &["\"autoencoder.clips\" was 4 and is 2"]);
    check(
        "clips = 4",
        "clips = 2\naccumulate = 2",
        &["autoencoder.clips", "\"autoencoder.accumulate\" was 1 and is 2"],
    );
    check("average = 0.9", "average = 0.8", &["autoencoder.average"]);
    check("seed = 1", "seed = 2", &["\"seed\" was 1 and is 2"]);
    check("seed = 1", "seed = 1\nroad_users = 3.0", &["\"road_users\" was 1.0 and is 3.0"]);
    check("sets = [\"clips\"]", "sets = [\"broad\"]", &["autoencoder.sets"]);
    // The cosine's rates depend on the number of steps.
    check("steps = 6", "steps = 8", &["\"autoencoder.steps\" was 6 and is 8"]);
    // What the stage does not depend on may change.
    let other =
        text.replacen("checkpoint_every = 1", "checkpoint_every = 2", 1).replace("guidance = 1.5", "guidance = 2.0");
    let other =
        load(folder.path(), &other.replacen("seed = 1", "seed = 1\ncache_source = \"clean\"", 1)).expect("valid");
    Stage::Autoencoder.run(&other, &mut Silent).expect("the autoencoder is trained as before");
}

#[test]
fn training_at_a_constant_rate_can_be_lengthened() {
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let text = |folder: &Path, steps: u32| {
        let text = six_steps(folder).replacen("warm_up = 5", "warm_up = 5\nschedule = \"constant\"", 1);
        load(folder, &text.replacen("steps = 6", &format!("steps = {steps}"), 1)).expect("valid")
    };
    let (whole, short, longer) = (text(a.path(), 8), text(b.path(), 6), text(b.path(), 8));
    for config in [&whole, &short, &longer] {
        Stage::Autoencoder.run(config, &mut Silent).expect("trains");
    }
    assert_eq!(weights(&whole, "autoencoder").digest(), weights(&longer, "autoencoder").digest());
    let error = Stage::Autoencoder.run(&short, &mut Silent).expect_err("eight steps were made");
    assert!(error.to_string().contains("\"autoencoder.steps\" was 8 and is 6"), "{error}");
}

#[test]
fn micro_batches_give_the_bits_of_one_batch() {
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let text =
        |folder: &Path, clips: &str| load(folder, &six_steps(folder).replacen("clips = 4", clips, 1)).expect("valid");
    let (once, often) = (text(a.path(), "clips = 6"), text(b.path(), "clips = 2\naccumulate = 3"));
    for config in [&once, &often] {
        Stage::Autoencoder.run(config, &mut Silent).expect("trains");
    }
    assert_eq!(weights(&once, "autoencoder").digest(), weights(&often, "autoencoder").digest());
}
