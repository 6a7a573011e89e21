//! Worlds with withheld effects, for blind diagnosis: drawn, and the answer sealed beside its key.

use std::path::{Path, PathBuf};

use ds_effect::{Effect, Insertion, Parameter, Scale};
use ds_space::Draws;
use ring::aead::{Aad, CHACHA20_POLY1305, LessSafeKey, NONCE_LEN, Nonce, UnboundKey};
use ring::rand::{SecureRandom, SystemRandom};

use crate::error::{CasesError, at};
use crate::world::{EffectLine, RunConfig};

/// Draws one or two effects that a drive can show; the draw depends on the seed alone.
#[must_use]
pub fn withheld(seed: u64, mass_kg: f64) -> RunConfig {
    let drawable: Vec<&Effect> =
        ds_effect::library().iter().copied().filter(|effect| can_be_withheld(effect)).collect();
    let draws = Draws::from_seed(seed, "withheld effects");
    let count = if draws.uniform(0) < 0.2 { 2 } else { 1 };
    let mut effects: Vec<EffectLine> = Vec::new();
    let mut index = 1;
    while effects.len() < count {
        let effect = drawable[draws.below(index, drawable.len() as u64) as usize];
        if effects.iter().all(|line| line.id != effect.id) {
            let values = effect.parameters.iter().zip(0..).map(|(parameter, k)| {
                parameter.reported(search_value(parameter, draws.uniform(100 * index + k)), mass_kg)
            });
            effects.push(EffectLine { id: effect.id.to_owned(), values: values.collect() });
        }
        index += 1;
    }
    RunConfig { effects, ..RunConfig::default() }
}

/// Followers need dense traffic, what others decide and the map a diagnosis with a scene, wind a drag area, and clocks
/// of messages are not in the log; a switch has no strength.
fn can_be_withheld(effect: &Effect) -> bool {
    let shown = !matches!(effect.insertion, Insertion::Agent | Insertion::Map) && effect.id != "obs_latency";
    effect.suspect && shown && !matches!(effect.id, "kinematic_only" | "brake_fade" | "wind_steady")
}

/// Returns a value in the upper or lower half of the searched range, away from neutral by at least a fifth of it.
fn search_value(parameter: &Parameter, u: f64) -> f64 {
    let (low, high) = parameter.slab;
    if parameter.neutral.is_finite() && parameter.neutral > low && !matches!(parameter.scale, Scale::Limit) {
        let (side, v) = if u < 0.5 { (low, 2.0 * u) } else { (high, 2.0 * u - 1.0) };
        return parameter.neutral + (0.3 + 0.7 * v) * (side - parameter.neutral);
    }
    low + (0.2 + 0.8 * u) * (high - low)
}

/// Returns an error about a sealed answer.
fn refused(path: &Path, problem: &'static str) -> CasesError {
    CasesError::Seal { path: path.to_path_buf(), problem }
}

fn fill(bytes: &mut [u8], path: &Path) -> Result<(), CasesError> {
    SystemRandom::new().fill(bytes).map_err(|_| refused(path, "the system gives no random numbers"))
}

/// Writes an answer encrypted, its key beside it in `FILE.key`.
///
/// # Errors
/// If the system gives no random numbers, or a file cannot be written.
pub fn seal(answer: &RunConfig, path: &Path) -> Result<(), CasesError> {
    let mut key = [0; 32];
    let mut nonce = [0; NONCE_LEN];
    fill(&mut key, path)?;
    fill(&mut nonce, path)?;
    let mut bytes = answer.to_toml().into_bytes();
    // The length would tell one effect from two.
    let padded = bytes.len().next_multiple_of(1024);
    bytes.resize(padded, b'\n');
    let failed = |_| refused(path, "the answer cannot be sealed");
    let cipher = LessSafeKey::new(UnboundKey::new(&CHACHA20_POLY1305, &key).map_err(failed)?);
    let unique = Nonce::assume_unique_for_key(nonce);
    cipher.seal_in_place_append_tag(unique, Aad::empty(), &mut bytes).map_err(failed)?;
    write(path, &[&nonce[..], &bytes[..]].concat())?;
    write(&key_of(path), &key)
}

/// Opens what [`seal`] wrote.
///
/// # Errors
/// If answer or key cannot be read, or do not belong together.
pub fn unseal(path: &Path) -> Result<RunConfig, CasesError> {
    let read = |path: &Path| std::fs::read(path).map_err(at(path));
    let (sealed, key) = (read(path)?, read(&key_of(path))?);
    if sealed.len() <= NONCE_LEN {
        return Err(refused(path, "no sealed answer"));
    }
    let (nonce, bytes) = sealed.split_at(NONCE_LEN);
    let failed = |_| refused(path, "does not open with its key");
    let cipher = LessSafeKey::new(UnboundKey::new(&CHACHA20_POLY1305, &key).map_err(failed)?);
    let mut bytes = bytes.to_vec();
    let nonce = Nonce::try_assume_unique_for_key(nonce).map_err(failed)?;
    let text = cipher.open_in_place(nonce, Aad::empty(), &mut bytes).map_err(failed)?;
    let text = std::str::from_utf8(text).map_err(|_| refused(path, "the answer is no text"))?;
    toml::from_str(text).map_err(|source| CasesError::Config { path: path.to_path_buf(), source: Box::new(source) })
}

/// Draws effects from random numbers of the system, seals them and returns them.
///
/// # Errors
/// If the answer is there already, or cannot be sealed.
pub fn draw_and_seal(path: &Path, mass_kg: f64, seed: Option<u64>) -> Result<RunConfig, CasesError> {
    if path.exists() {
        return Err(refused(path, "exists, and a sealed answer is never overwritten"));
    }
    let seed = match seed {
        Some(seed) => seed,
        None => {
            let mut bytes = [0; 8];
            fill(&mut bytes, path)?;
            u64::from_le_bytes(bytes)
        }
    };
    let drawn = withheld(seed, mass_kg);
    seal(&drawn, path)?;
    Ok(drawn)
}

fn key_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".key");
    PathBuf::from(name)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CasesError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(at(folder))?;
    }
    std::fs::write(path, bytes).map_err(at(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sealed_answer_opens_with_its_key_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("answer.sealed");
        let drawn = draw_and_seal(&path, 1500.0, Some(3)).expect("sealed");
        assert_eq!(unseal(&path).expect("opened"), drawn);
        assert!(draw_and_seal(&path, 1500.0, Some(4)).is_err(), "an answer was overwritten");
        let sealed = std::fs::read(&path).expect("bytes");
        let id = drawn.effects[0].id.as_bytes();
        assert!(!sealed.windows(id.len()).any(|window| window == id), "the name is readable");
        std::fs::write(key_of(&path), [0; 32]).expect("another key");
        assert!(unseal(&path).is_err());
    }

    #[test]
    fn withheld_effects_are_sound_and_not_always_the_same() {
        let drawn: Vec<RunConfig> = (0..40).map(|seed| withheld(seed, 1500.0)).collect();
        for line in drawn.iter().flat_map(|config| &config.effects) {
            ds_effect::check(&line.id, &line.values).expect("a sound setting");
        }
        let ids: std::collections::BTreeSet<&str> = drawn.iter().map(|config| config.effects[0].id.as_str()).collect();
        assert!(ids.len() > 10, "{ids:?}");
        assert!(drawn.iter().any(|config| config.effects.len() == 2));
    }
}
