//! Published configurations against files of their names and shapes: counts, totals, wrappers, shards, namings.

use std::path::Path;

use crate::files::{Entry, dictionary, tensor, torch, write_holes};
use ds_nn::checkpoint::{Checkpoint, CheckpointError, Finite, Naming};
use ds_nn::dit::{DitShape, Gelu};
use ds_nn::{Declared, Initial};

fn wan_1_3b() -> DitShape {
    DitShape {
        layers: 30,
        dim: 1536,
        heads: 12,
        ffn: 8960,
        latent_channels: 16,
        control_inputs: 0,
        control_channels: 0,
        start_channels: 0,
        freq_dim: 256,
        text_dim: 4096,
        text_len: 512,
        image_context: false,
        clip_dim: 0,
        reference: false,
        gelu: Gelu::Tanh,
        start_every: false,
        cross_every: 1,
        grid_h: 30,
        grid_w: 52,
    }
}

fn fun_1_3b() -> DitShape {
    DitShape { control_channels: 16, start_channels: 16, clip_dim: 1280, reference: true, ..wan_1_3b() }
}

fn wan_5b() -> DitShape {
    DitShape { dim: 3072, heads: 24, ffn: 14_336, latent_channels: 48, grid_h: 22, grid_w: 40, ..wan_1_3b() }
}

fn entries(declared: &[Declared]) -> Vec<Entry> {
    declared.iter().map(|weight| (weight.name.clone(), "BF16", weight.shape.clone())).collect()
}

#[test]
fn files_of_the_published_names_and_shapes_fit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("diffusion_pytorch_model.safetensors");
    let table = [
        (wan_1_3b(), 825, 1_418_996_800),
        (DitShape { reference: false, ..fun_1_3b() }, 983, 1_564_502_336),
        (fun_1_3b(), 985, 1_564_602_176),
        (wan_5b(), 825, 4_999_787_712),
    ];
    for (shape, tensors, parameters) in table {
        write_holes(&path, &entries(&shape.declare()));
        let checkpoint = Checkpoint::open(folder.path()).expect("opens");
        let fitted = checkpoint.fit(&shape.declare(), Naming::Transformer).expect("fits");
        assert_eq!((fitted.tensors(), fitted.parameters()), (tensors, parameters), "{shape:?}");
    }
}

/// What was done to the names and shapes, and what the error must be.
type Spoiled = (&'static str, fn(&mut Vec<Entry>), fn(&CheckpointError) -> bool);

#[test]
fn dropped_added_and_transposed_keys_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.safetensors");
    let cases: [Spoiled; 3] = [
        (
            "dropped",
            |list| list.retain(|e| e.0 != "blocks.7.cross_attn.k_img.bias"),
            |error| matches!(error, CheckpointError::Missing { name, .. } if name == "blocks.7.cross_attn.k_img.bias"),
        ),
        (
            "added",
            |list| list.push(("blocks.30.modulation".to_owned(), "BF16", vec![1, 6, 1536])),
            |error| matches!(error, CheckpointError::Unexpected { name } if name == "blocks.30.modulation"),
        ),
        (
            "transposed",
            |list| list.iter_mut().find(|e| e.0 == "blocks.3.ffn.0.weight").expect("there").2.reverse(),
            |error| {
                matches!(error, CheckpointError::Shape { name, expected, found }
                if name == "blocks.3.ffn.0.weight" && *expected == [8960, 1536] && *found == [1536, 8960])
            },
        ),
    ];
    for (what, spoil, expected) in cases {
        let mut list = entries(&fun_1_3b().declare());
        spoil(&mut list);
        write_holes(&path, &list);
        let checkpoint = Checkpoint::open(&path).expect("opens");
        let error = checkpoint.fit(&fun_1_3b().declare(), Naming::Transformer).err().expect(what);
        assert!(expected(&error), "{what}: {error}");
    }
}

#[test]
fn wrappers_of_training_are_taken_off_and_the_averaged_generator_is_chosen() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("checkpoint.safetensors");
    let named = |name: &str, shape: &[usize]| (name.to_owned(), "F32", shape.to_vec());
    write_holes(
        &path,
        &[
            named("critic.model.head.bias", &[7]),
            named("generator.model.head.bias", &[3]),
            named("generator_ema.model._fsdp_wrapped_module.head._checkpoint_wrapped_module.bias", &[2]),
        ],
    );
    let shape = |part| Checkpoint::open_part(&path, part).expect("opens").shape("head.bias").map(<[usize]>::to_vec);
    assert_eq!(shape(None), Some(vec![2]));
    assert_eq!(shape(Some("generator")), Some(vec![3]));
    assert_eq!(shape(Some("critic")), Some(vec![7]));
    assert_eq!(shape(Some("ema")), None);
    write_holes(&path, &[named("model.head.bias", &[2]), named("module._orig_mod.head.bias", &[2])]);
    let error = Checkpoint::open(&path).err().expect("two tensors of one name");
    assert!(matches!(&error, CheckpointError::Ambiguous { name, .. } if name == "head.bias"), "{error}");
}

#[test]
fn shards_are_joined_and_must_agree_with_their_index() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let named = |name: &str| (name.to_owned(), "BF16", vec![2]);
    let place = |name: &str| folder.path().join(name);
    write_holes(&place("one.safetensors"), &[named("a")]);
    write_holes(&place("two.safetensors"), &[named("b")]);
    let index = |text: &str| {
        std::fs::write(place("model.safetensors.index.json"), format!("{{\"weight_map\":{{{text}}}}}"))
            .expect("written");
        Checkpoint::open(folder.path())
    };
    let names: Vec<String> = index("\"a\":\"one.safetensors\",\"b\":\"two.safetensors\"")
        .expect("opens")
        .iter()
        .map(|(name, _)| name.to_owned())
        .collect();
    assert_eq!(names, ["a", "b"]);
    let check = |text: &str, expected: &str| {
        let error = index(text).err().expect(text).to_string();
        assert!(error.contains(expected), "{error}");
    };
    check(
        "\"a\":\"one.safetensors\",\"c\":\"one.safetensors\"",
        "\"c\" in \"one.safetensors\", which does not hold it",
    );
    check("\"a\":\"one.safetensors\",\"c\":\"two.safetensors\"", "\"b\", which the index does not place there");
    check("\"a\":\"../one.safetensors\"", "no plain file name");
    check("\"a\":\"three.safetensors\"", "three.safetensors");
}

#[test]
fn archives_give_their_values_also_where_they_are_transposed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.pth");
    let read = |shape: &[u32], strides: &[u32]| {
        let pickle = dictionary("w", &tensor("FloatStorage", shape, strides));
        std::fs::write(&path, torch(&pickle, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).expect("is written");
        let declared = [Declared::new("w", &[shape[0] as usize, shape[1] as usize], Initial::Constant(0.0))];
        let checkpoint = Checkpoint::open(&path).expect("opens");
        let weights = checkpoint.fit(&declared, Naming::Plain).expect("fits").weights(Finite::Checked).expect("reads");
        weights.get("w").expect("there").values().to_vec()
    };
    assert_eq!(read(&[2, 3], &[3, 1]), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(read(&[3, 2], &[1, 3]), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
}

#[test]
fn half_formats_are_widened() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.safetensors");
    let entries = [("b".to_owned(), "BF16", vec![2]), ("h".to_owned(), "F16", vec![2])];
    let (header, _) = crate::files::header(&entries);
    // 1.5 and −2 in each format.
    let values = [0x3fc0u16, 0xc000, 0x3e00, 0xc000];
    let values: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(&path, [header, values].concat()).expect("is written");
    let checkpoint = Checkpoint::open(Path::new(&path)).expect("opens");
    for name in ["b", "h"] {
        assert_eq!(checkpoint.read(name).expect("reads").values(), [1.5, -2.0]);
    }
}
