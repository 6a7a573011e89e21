//! The world of a run beyond the nominal one: effects from flags and files, or withheld ones that are drawn and sealed.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use ds_effect::{Effect, Insertion, Parameter, Scale};
use ds_space::Draws;
use ds_wire::control as pb;
use ring::aead::{Aad, CHACHA20_POLY1305, LessSafeKey, NONCE_LEN, Nonce, UnboundKey};
use ring::rand::{SecureRandom, SystemRandom};
use serde::{Deserialize, Serialize};

/// What a configuration file of a run may say.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RunConfig {
    /// Effects that the world has beyond the nominal one.
    pub effects: Vec<EffectLine>,
}

/// One effect with its values, one per parameter, in reported units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EffectLine {
    /// Its id.
    pub id: String,
    /// Its values.
    pub values: Vec<f64>,
}

impl EffectLine {
    /// Reads `id=value` or `id=value,value`.
    fn parse(text: &str) -> Result<Self> {
        let (id, values) = text.split_once('=').with_context(|| format!("--effect {text:?} is not ID=VALUE"))?;
        let number = |value: &str| value.trim().parse::<f64>().with_context(|| format!("--effect {text:?}: {value:?}"));
        Ok(Self { id: id.trim().to_owned(), values: values.split(',').map(number).collect::<Result<_>>()? })
    }
}

impl RunConfig {
    /// Reads a configuration file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{} is no run configuration", path.display()))
    }

    /// Returns the effects of a file, if any, and of flags, checked.
    pub(crate) fn gather(file: Option<&PathBuf>, flags: &[String]) -> Result<Self> {
        let mut config = file.map(|path| Self::read(path)).transpose()?.unwrap_or_default();
        for flag in flags {
            config.effects.push(EffectLine::parse(flag)?);
        }
        for line in &config.effects {
            ds_effect::check(&line.id, &line.values)
                .map_err(|error| anyhow!("{error}; `dreamstream gap effects` lists them"))?;
        }
        Ok(config)
    }

    /// Returns the effects as a run's settings carry them.
    pub(crate) fn switched(&self) -> Vec<pb::SwitchedEffect> {
        let switched = |line: &EffectLine| pb::SwitchedEffect { id: line.id.clone(), values: line.values.clone() };
        self.effects.iter().map(switched).collect()
    }
}

/// Draws one or two effects that a drive can show; the draw depends on the seed alone.
pub(crate) fn withheld(seed: u64, mass_kg: f64) -> RunConfig {
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
    RunConfig { effects }
}

/// Followers need dense traffic, what others decide and the map a diagnosis with a scene, wind a drag area, and clocks of messages are not in the log; a switch has no strength.
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

/// Writes an answer encrypted, its key beside it in `FILE.key`.
pub(crate) fn seal(answer: &RunConfig, path: &Path) -> Result<()> {
    let random = SystemRandom::new();
    let mut key = [0; 32];
    let mut nonce = [0; NONCE_LEN];
    random
        .fill(&mut key)
        .and_then(|()| random.fill(&mut nonce))
        .map_err(|_| anyhow!("the system gives no random numbers"))?;
    let mut bytes = toml::to_string(answer).context("the answer as TOML")?.into_bytes();
    // The length would tell one effect from two.
    let padded = bytes.len().next_multiple_of(1024);
    bytes.resize(padded, b'\n');
    let failed = |_| anyhow!("the answer cannot be sealed");
    let cipher = LessSafeKey::new(UnboundKey::new(&CHACHA20_POLY1305, &key).map_err(failed)?);
    let unique = Nonce::assume_unique_for_key(nonce);
    cipher.seal_in_place_append_tag(unique, Aad::empty(), &mut bytes).map_err(failed)?;
    write(path, &[&nonce[..], &bytes[..]].concat())?;
    write(&key_of(path), &key)
}

/// Opens what [`seal`] wrote.
pub(crate) fn unseal(path: &Path) -> Result<RunConfig> {
    let read = |path: &Path| std::fs::read(path).with_context(|| format!("read {}", path.display()));
    let (sealed, key) = (read(path)?, read(&key_of(path))?);
    ensure!(sealed.len() > NONCE_LEN, "{} is no sealed answer", path.display());
    let (nonce, bytes) = sealed.split_at(NONCE_LEN);
    let failed = |_| anyhow!("{} does not open with its key", path.display());
    let cipher = LessSafeKey::new(UnboundKey::new(&CHACHA20_POLY1305, &key).map_err(failed)?);
    let mut bytes = bytes.to_vec();
    let nonce = Nonce::try_assume_unique_for_key(nonce).map_err(failed)?;
    let text = cipher.open_in_place(nonce, Aad::empty(), &mut bytes).map_err(failed)?;
    toml::from_str(std::str::from_utf8(text).context("the answer is no text")?).context("the answer is no TOML")
}

/// Draws effects from random numbers of the system, seals them and returns them.
pub(crate) fn draw_and_seal(path: &Path, mass_kg: f64, seed: Option<u64>) -> Result<RunConfig> {
    if path.exists() {
        bail!("{} exists: a sealed answer is never overwritten", path.display());
    }
    let seed = match seed {
        Some(seed) => seed,
        None => {
            let mut bytes = [0; 8];
            SystemRandom::new().fill(&mut bytes).map_err(|_| anyhow!("the system gives no random numbers"))?;
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

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    }
    std::fs::write(path, bytes).with_context(|| format!("write {}", path.display()))
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

    #[test]
    fn flags_are_read_and_refused() {
        let flags = |text: &str| RunConfig::gather(None, &[text.to_owned()]);
        assert_eq!(flags("steer_delay=0.1").expect("sound").effects[0].values, [0.1]);
        assert_eq!(flags("wind_steady=3,-2").expect("sound").effects[0].values, [3.0, -2.0]);
        for bad in ["steer_delay", "steer_delay=x", "wind_steady=3", "nothing=1"] {
            assert!(flags(bad).is_err(), "{bad} was accepted");
        }
    }
}
