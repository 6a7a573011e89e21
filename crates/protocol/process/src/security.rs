//! TLS and token of the control plane, and the rule that nothing is spoken in clear beyond loopback.
//!
//! The orchestrator shows a certificate that the authority of all services signed, and takes in whoever brings the
//! token. The files are made by `dreamstream certs`; on loopback none of them is needed.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_bus::TlsFiles;
use ds_space::Digest;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity, ServerTlsConfig};
use tonic::{Request, Status};

use crate::section::SecuritySection;

/// The largest accepted PEM or token file, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;
const AUTHORIZATION: &str = "authorization";

impl SecuritySection {
    /// Returns the files of a TLS link, if there are any.
    #[must_use]
    pub fn files(&self) -> Option<TlsFiles> {
        let (ca, certificate, key) = (self.ca.clone(), self.certificate.clone(), self.key.clone());
        [&ca, &certificate, &key].iter().all(|path| given(path)).then_some(TlsFiles { ca, certificate, key })
    }

    /// Refuses a bus endpoint in clear beyond loopback.
    ///
    /// # Errors
    /// If it is one and `insecure` is not set.
    pub fn check_endpoint(&self, key: &str, endpoint: &str) -> Result<()> {
        ensure!(
            self.insecure
                || endpoint.starts_with("tls/")
                || endpoint.starts_with("unixsock-stream/")
                || on_loopback(endpoint),
            "setting \"{key}\" is {endpoint:?}: beyond loopback only as \"tls/…\" with certificates (see `dreamstream \
             certs`), or with \"security.insecure = true\""
        );
        Ok(())
    }

    /// Returns how the server of a setting opens, such as `control.listen`.
    ///
    /// # Errors
    /// If a file cannot be read, or the server would be reached from beyond loopback in clear.
    pub fn door(&self, key: &str, listen: SocketAddr) -> Result<Door> {
        let secured = self.files().is_some() && given(&self.token);
        ensure!(
            listen.ip().is_loopback() || secured || self.insecure,
            "setting \"{key}\" is {listen}: beyond loopback only with \"security.certificate\", \"key\", \"ca\" and \
             \"token\" (see `dreamstream certs`), or with \"security.insecure = true\""
        );
        let shown = |files: TlsFiles| {
            let identity = Identity::from_pem(read(&files.certificate)?, read(&files.key)?);
            anyhow::Ok(ServerTlsConfig::new().identity(identity))
        };
        let tls = self.files().map(shown).transpose()?;
        Ok(Door { listen, tls, guard: Guard(self.token()?.as_deref().map(digest)), insecure: self.insecure })
    }

    fn token(&self) -> Result<Option<String>> {
        if !given(&self.token) {
            return Ok(None);
        }
        let token = String::from_utf8(read(&self.token)?).context("token file is not text")?.trim().to_owned();
        ensure!(token.len() >= 16, "token file holds fewer than 16 characters: {:?}", self.token);
        Ok(Some(token))
    }
}

fn given(path: &Path) -> bool {
    !path.as_os_str().is_empty()
}

fn read(path: &PathBuf) -> Result<Vec<u8>> {
    let bytes = std::fs::metadata(path).with_context(|| format!("read {}", path.display()))?.len();
    ensure!(bytes <= MAX_FILE_BYTES, "{} holds {bytes} bytes, the limit is {MAX_FILE_BYTES}", path.display());
    std::fs::read(path).with_context(|| format!("read {}", path.display()))
}

fn digest(token: &str) -> Digest {
    Digest::of(format!("Bearer {token}").as_bytes())
}

/// Says whether an endpoint such as `tcp/127.0.0.1:7447` stays on this host.
fn on_loopback(endpoint: &str) -> bool {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    let host = address.split(['?', '#']).next().unwrap_or_default();
    let host = host.rsplit_once(':').map_or(host, |(host, _)| host).trim_matches(['[', ']']);
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// How a server opens: where, with what certificate, to whom.
#[derive(Debug)]
pub struct Door {
    /// Where it listens.
    pub listen: SocketAddr,
    /// What it shows.
    pub tls: Option<ServerTlsConfig>,
    /// Whom it takes in.
    pub guard: Guard,
    /// Whether anybody on the network may be taken in, in clear.
    pub insecure: bool,
}

/// Takes in calls that bring the token; all of them where there is none.
#[derive(Debug, Clone)]
pub struct Guard(Option<Digest>);

impl Interceptor for Guard {
    fn call(&mut self, request: Request<()>) -> Result<Request<()>, Status> {
        let Some(wanted) = &self.0 else { return Ok(request) };
        // Digests are compared, so that the time it takes says nothing about the token.
        match request.metadata().get(AUTHORIZATION).map(|value| Digest::of(value.as_bytes())) {
            Some(found) if found == *wanted => Ok(request),
            Some(_) => Err(Status::unauthenticated("the token is not this orchestrator's")),
            None => Err(Status::unauthenticated("a token is asked for: set \"security.token\"")),
        }
    }
}

/// Adds the token to every call.
#[derive(Debug, Clone, Default)]
pub struct Bearer(Option<MetadataValue<Ascii>>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            request.metadata_mut().insert(AUTHORIZATION, token.clone());
        }
        Ok(request)
    }
}

/// A connection to the orchestrator.
pub type Control = InterceptedService<Channel, Bearer>;

/// How to reach the orchestrator.
#[derive(Debug, Clone)]
pub struct Dial {
    address: String,
    endpoint: Endpoint,
    bearer: Bearer,
}

impl Dial {
    /// Reads what the settings name; an `https` address is checked against the authority.
    ///
    /// # Errors
    /// If the address is none, a file cannot be read, or the address is in clear beyond loopback.
    pub fn new(address: &str, security: &SecuritySection) -> Result<Self> {
        let mut endpoint = Endpoint::from_shared(address.to_owned())
            .with_context(|| format!("orchestrator address {address:?} is not a URI"))?
            .tcp_nodelay(true);
        let uri = endpoint.uri();
        let encrypted = uri.scheme_str() == Some("https");
        let local = uri.host().is_some_and(|host| on_loopback(&format!("tcp/{host}:0")));
        ensure!(
            encrypted || local || security.insecure,
            "orchestrator address {address:?} is in clear beyond loopback: use https with \"security.ca\" and \
             \"security.token\", or set \"security.insecure = true\""
        );
        if encrypted {
            ensure!(given(&security.ca), "orchestrator address {address:?} needs \"security.ca\"");
            let tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(read(&security.ca)?));
            endpoint = endpoint.tls_config(tls).context("TLS to the orchestrator")?;
        }
        let bearer = security.token()?.map(|token| format!("Bearer {token}").parse()).transpose();
        let bearer = Bearer(bearer.context("token file holds characters that no header may")?);
        Ok(Self { address: address.to_owned(), endpoint, bearer })
    }

    /// Reaches an orchestrator on this host without TLS.
    ///
    /// # Errors
    /// If the address is none.
    pub fn local(address: &str) -> Result<Self> {
        Self::new(address, &SecuritySection::default())
    }

    /// Returns the address.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Connects, within a limit.
    ///
    /// # Errors
    /// If nobody answers or the certificate is not the authority's.
    pub async fn connect(&self, limit: std::time::Duration) -> Result<Control, tonic::transport::Error> {
        let channel = self.endpoint.clone().connect_timeout(limit).connect().await?;
        Ok(InterceptedService::new(channel, self.bearer.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_clear_leaves_the_host() {
        let plain = SecuritySection::default();
        let insecure = SecuritySection { insecure: true, ..SecuritySection::default() };
        for (endpoint, sound) in [
            ("tcp/127.0.0.1:7447", true),
            ("tcp/[::1]:7447", true),
            ("tcp/localhost:7447", true),
            ("tls/10.0.0.1:7447", true),
            ("unixsock-stream//run/bus", true),
            ("tcp/0.0.0.0:7447", false),
            ("tcp/10.0.0.1:7447", false),
            ("tcp/localhost.example.org:7447", false),
            ("tcp/[::]:7447", false),
        ] {
            assert_eq!(plain.check_endpoint("bus.listen", endpoint).is_ok(), sound, "{endpoint}");
            assert!(insecure.check_endpoint("bus.listen", endpoint).is_ok(), "{endpoint}");
        }
        for (address, sound) in [
            ("http://127.0.0.1:1", true),
            ("http://[::1]:1", true),
            ("http://host:1", false),
            ("https://host:1", false),
        ] {
            assert_eq!(Dial::new(address, &plain).is_ok(), sound, "{address}");
        }
        assert!(plain.door("control.listen", "0.0.0.0:1".parse().expect("an address")).is_err());
        assert!(insecure.door("metrics.listen", "0.0.0.0:1".parse().expect("an address")).is_ok());
    }

    #[test]
    fn only_the_token_lets_in() {
        let mut guard = Guard(Some(digest("0123456789abcdef")));
        let with = |text: &str| {
            let mut request = Request::new(());
            request.metadata_mut().insert(AUTHORIZATION, text.parse().expect("ASCII"));
            request
        };
        assert!(guard.call(with("Bearer 0123456789abcdef")).is_ok());
        for wrong in ["Bearer 0123456789abcdee", "0123456789abcdef", "Bearer ", ""] {
            assert!(guard.call(with(wrong)).is_err(), "{wrong:?}");
        }
        assert!(guard.call(Request::new(())).is_err());
        assert!(Guard(None).call(Request::new(())).is_ok());
    }
}
