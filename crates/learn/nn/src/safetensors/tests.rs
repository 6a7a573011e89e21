//! Hostile weight files: each broken in one way, each refused by name, none allocating what it claims.

use super::*;

fn file(header: &str, values: usize) -> Vec<u8> {
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend(std::iter::repeat_n(0u8, values));
    bytes
}

fn check(input: &[u8], expected: &str) {
    let outcome = WeightsFile::parse(&mut &input[..], input.len() as u64, Path::new("test"));
    let message = match &outcome {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    };
    assert!(message.contains(expected), "{message:?} lacks {expected:?}");
}

#[test]
fn hostile_files_are_refused_by_name() {
    let good = r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#;
    check(&file(good, 8), "accepted");
    check(&[], "header claims 8 bytes");
    check(&[1, 2, 3], "header claims 8 bytes");
    check(&u64::MAX.to_le_bytes(), "header claims 18446744073709551615 bytes, the file allows 0");
    check(&[100u64.to_le_bytes().to_vec(), vec![b'{'; 50]].concat(), "header claims 100 bytes, the file allows 50");
    check(&file("not json", 8), "header cannot be read");
    check(&file("[1,2]", 8), "header cannot be read");
    check(&file(good, 4), "\"a\" of shape [2] claims bytes 0 to 8 of 4");
    check(&file(good, 12), "\"(end of file)\"");
    // Ten gigabytes claimed by shape and offsets; then by shape alone; then a product that overflows.
    let huge = r#"{"a":{"dtype":"F32","shape":[2500000000],"data_offsets":[0,10000000000]}}"#;
    check(&file(huge, 8), "claims bytes 0 to 10000000000 of 8");
    check(&file(&good.replace("[2]", "[2500000000]"), 8), "shape [2500000000]");
    check(&file(&good.replace("[2]", "[9223372036854775807,9223372036854775807]"), 8), "\"a\"");
    check(&file(&good.replace("F32", "F64"), 8), "type \"F64\"");
    check(&file(&good.replace("[0,8]", "[8,0]"), 8), "claims bytes 8 to 0");
    check(&file(&good.replace("[2]", "[-1]"), 8), "header cannot be read");
    check(&file(&good.replace("\"shape\"", "\"extra\":1,\"shape\""), 8), "header cannot be read");
    let overlap = r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},"b":{"dtype":"F32","shape":[2],"data_offsets":[4,12]}}"#;
    check(&file(overlap, 12), "\"b\" begins at byte 4, 8 expected");
    check(&file(&overlap.replace("[4,12]", "[12,20]"), 20), "\"b\" begins at byte 12, 8 expected");
    check(&file(r#"{"__metadata__":{"a":7}}"#, 0), "header cannot be read");
}

#[test]
fn weights_come_back_as_written() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.safetensors");
    let mut file = WeightsFile::default();
    file.weights.insert("matrix", Array::new(&[2, 3], vec![1.0, -2.5, f32::MIN_POSITIVE, 0.0, -0.0, 3e38]));
    file.weights.insert("empty", Array::zeros(&[0, 4]));
    file.weights.insert("scalar", Array::new(&[], vec![7.0]));
    file.metadata.insert("licence".to_owned(), "Apache-2.0".to_owned());
    file.write(&path).expect("writes");
    assert_eq!(WeightsFile::read(&path).expect("reads"), file);
}

#[test]
fn a_file_that_is_absent_says_so() {
    let error = WeightsFile::read(Path::new("/absent/weights.safetensors")).expect_err("there is no such file");
    assert!(error.to_string().contains("cannot be opened"), "{error}");
}

#[test]
fn half_precision_takes_half_the_room() {
    let mut file = WeightsFile::default();
    file.weights.insert("a", Array::new(&[2, 2], vec![0.5, -3.25, 1e-3, 4096.0]));
    let folder = std::env::temp_dir().join(format!("dreamstream-half-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let [whole, half] = ["whole", "half"].map(|name| folder.join(name));
    file.write(&whole).and_then(|()| file.write_half(&half)).expect("written");
    let size = |path: &Path| std::fs::metadata(path).expect("is there").len();
    // Headers of whole multiples of eight bytes.
    assert!(size(&half) < size(&whole), "{} of {}", size(&half), size(&whole));
    assert_eq!(WeightsFile::read(&whole).expect("reads"), file);
    let found = WeightsFile::read(&half).expect("reads").weights;
    let values = found.get("a").expect("is there").values();
    let error = |(a, b): (&f32, &f32)| (a - b).abs() / b.abs();
    assert!(values.iter().zip([0.5, -3.25, 1e-3, 4096.0].iter()).map(error).all(|error| error < 1e-3), "{values:?}");
    std::fs::remove_dir_all(&folder).expect("removed");
}
