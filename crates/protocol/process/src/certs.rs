//! Credentials of a fleet: an authority, one certificate per service, and the token of the control plane.
//!
//! Keys are readable by their owner alone. The key of the authority stays in the folder so that later calls can add
//! certificates; no service needs it. Names in the certificates decide who may put what (see `ds_bus::access`).

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_space::InstanceId;
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};

/// For how much longer than the certificates the authority holds.
const AUTHORITY_DAYS: u32 = 3_650;
const SECONDS_PER_DAY: u64 = 86_400;

/// What a fleet needs.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Where the files go.
    pub folder: &'a Path,
    /// Names of policies that join from outside.
    pub policies: &'a [String],
    /// Names and addresses under which services are reached, besides their own.
    pub hosts: &'a [String],
    /// For how long the certificates hold.
    pub days: u32,
}

/// Makes what is missing in the folder; returns how many files were made and how many were there.
///
/// # Errors
/// If a name is refused or a file cannot be read or written.
pub fn make(wanted: &Wanted<'_>) -> Result<(u32, u32)> {
    let Wanted { folder, policies, .. } = *wanted;
    std::fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    let authority = authority(folder)?;
    let mut names = vec!["router".to_owned()];
    names.extend(ds_bus::STATIONS.iter().map(|(name, _)| (*name).to_owned()));
    for policy in policies {
        InstanceId::new(policy).with_context(|| format!("--policy {policy:?}"))?;
        ensure!(!names.contains(policy), "--policy {policy:?} is the name of a service");
        names.push(policy.clone());
    }
    let mut made = 0;
    for name in &names {
        made += u32::from(leaf(wanted, name, &authority)?);
    }
    for policy in policies {
        client_configuration(folder, policy)?;
    }
    made += u32::from(token(&folder.join("token"))?);
    Ok((made, names.len() as u32 + 1 - made))
}

fn key_path(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.key"))
}

fn certificate_path(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.pem"))
}

fn authority(folder: &Path) -> Result<Issuer<'static, KeyPair>> {
    let mut params = CertificateParams::default();
    params.distinguished_name.push(DnType::CommonName, "dreamstream authority");
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    hold_for(&mut params, AUTHORITY_DAYS)?;
    let (key_file, file) = (key_path(folder, "ca"), certificate_path(folder, "ca"));
    if key_file.exists() && file.exists() {
        let key = std::fs::read_to_string(&key_file).with_context(|| format!("read {}", key_file.display()))?;
        let key = KeyPair::from_pem(&key).with_context(|| format!("key in {}", key_file.display()))?;
        return Ok(Issuer::new(params, key));
    }
    ensure!(!key_file.exists() && !file.exists(), "{} holds half an authority: ca.pem or ca.key", folder.display());
    let key = KeyPair::generate().context("key of the authority")?;
    let certificate = params.self_signed(&key).context("certificate of the authority")?;
    write_secret(&key_file, &key.serialize_pem())?;
    write(&file, &certificate.pem())?;
    Ok(Issuer::new(params, key))
}

/// Makes a certificate for a name unless it is there; says whether it did.
fn leaf(wanted: &Wanted<'_>, name: &str, authority: &Issuer<'_, KeyPair>) -> Result<bool> {
    let (key_file, file) = (key_path(wanted.folder, name), certificate_path(wanted.folder, name));
    if key_file.exists() && file.exists() {
        return Ok(false);
    }
    let mut hosts = vec![name.to_owned(), "localhost".to_owned(), "127.0.0.1".to_owned(), "::1".to_owned()];
    hosts.extend(wanted.hosts.iter().cloned());
    let mut params = CertificateParams::new(hosts).context("--host")?;
    params.distinguished_name.push(DnType::CommonName, name);
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    hold_for(&mut params, wanted.days)?;
    let key = KeyPair::generate().with_context(|| format!("key of {name}"))?;
    let certificate = params.signed_by(&key, authority).with_context(|| format!("certificate of {name}"))?;
    write_secret(&key_file, &key.serialize_pem())?;
    write(&file, &certificate.pem())?;
    Ok(true)
}

/// Writes the Zenoh configuration with which a policy's process shows its certificate (`--config` of the Python client).
fn client_configuration(folder: &Path, policy: &str) -> Result<()> {
    let folder = std::fs::canonicalize(folder).with_context(|| format!("path of {}", folder.display()))?;
    let tls = serde_json::json!({
        "root_ca_certificate": certificate_path(&folder, "ca"),
        "connect_certificate": certificate_path(&folder, policy),
        "connect_private_key": key_path(&folder, policy),
        "enable_mtls": true,
        "verify_name_on_connect": true,
    });
    let text = serde_json::json!({"mode": "client", "transport": {"link": {"tls": tls}}});
    write(&folder.join(format!("{policy}.json5")), &format!("{text:#}\n"))
}

/// Lets a certificate hold from yesterday, for clocks that are a little off.
fn hold_for(params: &mut CertificateParams, days: u32) -> Result<()> {
    let day = std::time::Duration::from_secs(SECONDS_PER_DAY);
    let now = crate::clock::today();
    params.not_before = (now - day).into();
    params.not_after = (now + day * days).into();
    Ok(())
}

/// Draws a token of 256 bits unless it is there; says whether it did.
fn token(path: &Path) -> Result<bool> {
    if path.exists() {
        return Ok(false);
    }
    let mut bits = [0_u8; 32];
    File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bits)).context("draw a token")?;
    let text: String = bits.iter().map(|byte| format!("{byte:02x}")).collect();
    write_secret(path, &(text + "\n"))?;
    Ok(true)
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

fn write_secret(path: &Path, text: &str) -> Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(0o600);
    let mut file = options.open(path).with_context(|| format!("write {}", path.display()))?;
    file.write_all(text.as_bytes()).with_context(|| format!("write {}", path.display()))
}
