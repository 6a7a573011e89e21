//! Sets of clips as a whole: the same bytes on any number of threads and after any stop, foreign and broken files, edits.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use ds_camera::{LabelledCamera, PixelClass, ReferenceCamera, SceneCamera};
use ds_clips::{Clip, ClipPlan, ClipSet, ClipsError, Drive, Progress, Recipe, ScenarioKey, render, scene_of};
use ds_layout::colour;

fn configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/data")
}

/// Writes a recipe derived from a shipped one and reads it.
fn recipe(folder: &Path, name: &str, changes: &[(&str, &str)]) -> Recipe {
    let mut text = std::fs::read_to_string(configs().join(format!("{name}.toml"))).expect("the recipe is shipped");
    let models = configs().join("../models").display().to_string();
    text = text.replace("../models", &models);
    for (from, to) in changes {
        assert!(text.contains(from), "{name}.toml lacks {from:?}");
        text = text.replace(from, to);
    }
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, text).expect("writes");
    Recipe::load(&path).expect("the recipe is valid")
}

const SMALL: &[(&str, &str)] =
    &[("count = 8", "count = 3"), ("clips_each = 3", "clips_each = 2"), ("frames = 21", "frames = 5")];

struct Watch {
    stop_after: u64,
    made: AtomicU64,
}

impl Watch {
    fn new(stop_after: u64) -> Self {
        Self { stop_after, made: AtomicU64::new(0) }
    }
}

impl Progress for Watch {
    fn made(&self, clips: u64, _of: u64) {
        self.made.fetch_max(clips, Ordering::Relaxed);
    }
    fn stop(&self) -> bool {
        self.made.load(Ordering::Relaxed) >= self.stop_after
    }
}

fn all(recipe: &Recipe, folder: &Path) -> ClipSet {
    let rendered = render(recipe, folder, &Watch::new(u64::MAX)).expect("renders");
    assert_eq!(rendered.clips, rendered.of);
    ClipSet::open(folder).expect("opens")
}

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entry = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.expect("an entry").path();
        (path.file_name().expect("a name").to_string_lossy().into_owned(), std::fs::read(&path).expect("reads"))
    };
    let mut files: Vec<_> = std::fs::read_dir(folder).expect("a folder").map(entry).collect();
    files.sort();
    files
}

#[test]
fn a_set_has_the_same_bytes_on_one_thread_on_many_and_after_a_stop() {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = recipe(folder.path(), "smoke", &[SMALL, &[("shard_clips = 8", "shard_clips = 4")]].concat());
    let [one, many, stopped] = ["one", "many", "stopped"].map(|name| folder.path().join(name));
    for (threads, place) in [(1, &one), (3, &many)] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| all(&recipe, place));
    }
    let part = render(&recipe, &stopped, &Watch::new(5)).expect("stops");
    assert_eq!((part.clips, part.of), (4, 6), "the whole shards stay");
    assert!(ClipSet::open(&stopped).is_err(), "an unfinished set is not opened");
    let rest = render(&recipe, &stopped, &Watch::new(u64::MAX)).expect("goes on");
    assert_eq!((rest.made, rest.clips), (2, 6));
    let names: Vec<String> = files(&one).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["index.json", "shard-00000.clips", "shard-00001.clips"]);
    assert!(files(&one) == files(&many), "threads change the bytes");
    assert!(files(&one) == files(&stopped), "a stop changes the bytes");
}

#[test]
fn clips_are_read_by_spans_and_follow_from_what_is_told_of_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = recipe(folder.path(), "smoke", SMALL);
    let set = all(&recipe, &folder.path().join("set"));
    assert_eq!((set.len(), set.size()), (6, (64, 32)));
    for clip in 0..set.len() {
        let whole = set.whole(clip).expect("reads");
        assert_eq!((whole.frames.len(), whole.layouts.len(), whole.classes.len(), whole.geometry.len()), (5, 5, 5, 5));
        let span = set.read(clip, 2, 2).expect("reads");
        let expected = Clip {
            frames: whole.frames[2..4].to_vec(),
            layouts: whole.layouts[2..4].to_vec(),
            classes: whole.classes[2..4].to_vec(),
            geometry: whole.geometry[2..4].to_vec(),
            prompt: whole.prompt.clone(),
        };
        assert!(span == expected, "clip {clip}: a span is not a part of the whole");
        let layouts = set.layouts(clip, 2, 2).expect("reads");
        assert!(
            layouts == Clip { frames: Vec::new(), classes: Vec::new(), geometry: Vec::new(), ..expected },
            "clip {clip}: layouts alone"
        );
        let info = set.info(clip);
        let family = info.family.parse().expect("a family");
        let key = ScenarioKey::Generated { family, seed: info.seed.expect("generated") };
        let scene = scene_of(&key).expect("generates");
        assert_eq!((scene.digest.to_string(), &info.prompt), (info.scenario_digest.clone(), &whole.prompt));
        let (world, camera) = (Drive::from(info.drive).world(&scene, 3), info.camera.model().expect("a camera"));
        let pose = world.ego.pose.world_from_rig(0.0);
        let reference = ReferenceCamera::new(&scene, info.condition.appearance().expect("a look"));
        assert!(
            reference.render(&world, &camera, pose).expect("renders") == whole.frames[3],
            "clip {clip}: index and frame differ"
        );
        let geometry = &whole.geometry[3];
        assert_eq!(geometry.world_from_camera, pose * camera.rig_from_camera);
        assert_eq!(geometry.movers.len(), world.agents.len());
        let classes: Vec<u8> =
            reference.classes(&world, &camera, pose).expect("renders").into_iter().map(|class| class as u8).collect();
        assert_eq!(classes, whole.classes[3]);
        assert!(classes.iter().all(|class| usize::from(*class) < PixelClass::COUNT));
    }
    assert!(matches!(set.read(0, 3, 3), Err(ClipsError::Beyond { what: "tick", asked: 6, count: 5 })));
    assert!(matches!(set.read(6, 0, 1), Err(ClipsError::Beyond { what: "clip", asked: 6, count: 6 })));
}

#[test]
fn edits_keep_the_layouts_and_change_the_first_frame_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let narrow = recipe(folder.path(), "smoke", SMALL);
    let diverse = recipe(folder.path(), "smoke_diverse", &[("clips = 12", "clips = 4"), ("frames = 21", "frames = 5")]);
    let (narrow, edited) = (all(&narrow, &folder.path().join("a")), all(&diverse, &folder.path().join("b")));
    assert_eq!(edited.len(), 4);
    for clip in 0..edited.len() {
        let info = edited.info(clip);
        let original = usize::try_from(info.edited.expect("an edit")).expect("an index");
        let (new, old) = (edited.whole(clip).expect("reads"), narrow.whole(original).expect("reads"));
        assert!(new.layouts == old.layouts, "the layouts changed");
        assert_eq!((new.frames.len(), info.frames, info.ticks), (1, 1, 5));
        let change: f64 = new.frames[0]
            .rgb()
            .iter()
            .zip(old.frames[0].rgb())
            .map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs())
            .sum::<f64>()
            / new.frames[0].rgb().len() as f64;
        assert!(change > 8.0, "{}: the first frame changed by {change:.1} only", info.appearance);
        assert_ne!(new.prompt, old.prompt);
    }
}

#[test]
fn bare_clips_show_the_same_frames_beside_layouts_without_structures() {
    let folder = tempfile::tempdir().expect("a folder");
    let told = recipe(folder.path(), "smoke", SMALL);
    let bare = Recipe { bare: 1.0, ..told.clone() };
    let (told, bare) = (all(&told, &folder.path().join("told")), all(&bare, &folder.path().join("bare")));
    let mut shown = 0;
    for clip in 0..told.len() {
        let (told, bare) = (told.whole(clip).expect("reads"), bare.whole(clip).expect("reads"));
        assert!(told.frames == bare.frames && told.classes == bare.classes);
        for (told, bare) in told.layouts.iter().zip(&bare.layouts) {
            for (told, bare) in told.rgb().as_chunks::<3>().0.iter().zip(bare.rgb().as_chunks::<3>().0) {
                assert!(!colour::is_structure(*bare) && (told == bare || colour::is_structure(*told)));
                shown += usize::from(told != bare);
            }
        }
    }
    assert!(shown > 1_000, "{shown} pixels of structures");
}

#[test]
fn foreign_and_broken_folders_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = recipe(folder.path(), "smoke", &[SMALL, &[("clips_each = 2", "clips_each = 1")]].concat());
    let place = folder.path().join("set");
    all(&first, &place);
    let mut second = first.clone();
    second.seed += 1;
    let error = render(&second, &place, &Watch::new(u64::MAX)).expect_err("another recipe");
    assert!(matches!(error, ClipsError::Foreign { .. }), "{error}");
    let shard = place.join("shard-00000.clips");
    let whole = std::fs::read(&shard).expect("reads");
    let check = |bytes: &[u8], expected: &str| {
        std::fs::write(&shard, bytes).expect("writes");
        let set = ClipSet::open(&place);
        let message = match set {
            Err(error) => error.to_string(),
            Ok(set) => set.whole(0).map_or_else(|error| error.to_string(), |_| "no error".to_owned()),
        };
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check(&whole[..whole.len() - 9], "is broken");
    check(&whole[..10], "too short");
    let mut spoiled = whole.clone();
    spoiled[8..40].fill(0xff);
    check(&spoiled, "is broken");
    check(&whole, "no error");
}

#[test]
fn captioners_and_editors_are_asked_and_their_failures_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let changes = [("clips = 12", "clips = 1"), ("frames = 21", "frames = 2"), ("smoke.toml", "smoke.toml")];
    recipe(folder.path(), "smoke", &[("count = 8", "count = 1"), ("frames = 21", "frames = 2")]);
    let with = |editor: &str, captioner: &str| {
        let path = folder.path().join("smoke_diverse.toml");
        recipe(folder.path(), "smoke_diverse", &changes);
        let mut text = std::fs::read_to_string(&path).expect("reads");
        let hook = |script: &str| format!("command = [\"sh\", \"-c\", '{script}', \"hook\"]");
        text = text.replace("clips = 1\n", &format!("clips = 1\neditor = {{ {} }}\n", hook(editor)));
        text += &format!("\n[captioner]\n{}\n", hook(captioner));
        std::fs::write(&path, text).expect("writes");
        let place = tempfile::tempdir().expect("a folder");
        let recipe = Recipe::load(&path).expect("valid");
        render(&recipe, place.path(), &Watch::new(u64::MAX))
            .and_then(|_| ClipSet::open(place.path())?.whole(0))
            .map(|clip| clip.prompt)
            .unwrap_or_else(|error| error.to_string())
    };
    let copy = "cp \"$1\" \"$3\"";
    let check = |editor: &str, captioner: &str, expected: &str| {
        let found = with(editor, captioner);
        assert!(found.contains(expected), "{found:?} lacks {expected:?}");
    };
    check(copy, "test -s \"$1\" && grep -q ego_speed_mps \"$2\" && echo a  street \\n in snow", "a street");
    check(copy, "true", "0 bytes of prompt");
    check(copy, "echo no model >&2; exit 3", "no model");
    check("true", "echo a", "wrote no picture");
    check("echo x > \"$3\"", "echo a", "picture is refused");
}

#[test]
fn broken_recipes_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    recipe(folder.path(), "smoke", &[]);
    let path = folder.path().join("smoke.toml");
    let good = std::fs::read_to_string(&path).expect("reads");
    let check = |from: &str, to: &str, expected: &str| {
        assert!(good.contains(from), "{from:?}");
        std::fs::write(&path, good.replacen(from, to, 1)).expect("writes");
        let message = Recipe::load(&path).and_then(|recipe| ClipPlan::new(&recipe)).map(|_| String::new());
        let message = message.unwrap_or_else(|error| error.to_string());
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check("version = 1", "version = 2", "version");
    check("seed = 7", "sed = 7", "cannot be read");
    check("count = 8", "count = 0", "scenarios.count");
    check("clips_each = 3", "clips_each = 0", "clips_each");
    check("frames = 21", "frames = 0", "frames");
    check("seed = 7", "seed = 7\nbare = 1.5", "bare");
    check("lighting=day,weather=clear,surface=dry", "lighting=dawn", "\"lighting=dawn\" is none of");
    check("[appearance]", "[appearance]\nheld_out = [\"any\"]", "no condition is left");
    check("source = \"reference\"", "source = \"imported\"", "scenarios.files");
}

#[test]
fn snow_and_rain_can_be_left_out_of_frames_and_of_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let changes =
        [("count = 120", "count = 1"), ("frames = 41", "frames = 3"), ("shard_clips = 24", "shard_clips = 2")];
    let set = |falls: &str| {
        let changes: Vec<_> = changes.into_iter().chain([("falls = false", falls)]).collect();
        all(&recipe(folder.path(), "snow_rain", &changes), &folder.path().join(falls))
    };
    let (clear, usual) = (set("falls = false"), set("falls = true"));
    for clip in 0..clear.len() {
        let [clear, usual] = [&clear, &usual].map(|set| set.whole(clip).expect("reads"));
        let pixels = clear.frames[2].rgb().chunks_exact(3).zip(usual.frames[2].rgb().chunks_exact(3));
        let (all, covered) = (pixels.len(), pixels.filter(|(clear, usual)| clear != usual).count());
        assert!(covered > 100 && 2 * covered < all, "clip {clip}: {covered} pixels of {all} are covered");
        assert!(clear.layouts == usual.layouts && clear.prompt == usual.prompt, "clip {clip}");
    }
}
