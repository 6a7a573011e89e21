//! How a session joins the bus, and Zenoh's configuration made of it.
//!
//! Scouting is off unless asked for. Pushes never stall their sender for long: they wait 50 ms for a free buffer and are
//! dropped then, which closes no link; the receiver pulls. A hung process is noticed after the lease.

use zenoh::Config;

use crate::access::{self, TlsFiles};
use crate::error::{BusError, zenoh};
use crate::ports::free_port;

/// For so long an endpoint may stay out of reach while a session opens, in milliseconds.
const CONNECT_MILLIS: u64 = 10_000;

/// How a session takes part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Talks to whom it is connected.
    #[default]
    Peer,
    /// Talks through one router.
    Client,
    /// Routes between its clients.
    Router,
}

impl Mode {
    fn name(self) -> &'static str {
        match self {
            Self::Peer => "peer",
            Self::Client => "client",
            Self::Router => "router",
        }
    }
}

/// Settings of a session. The default is the embedded one: a peer that neither listens nor connects.
#[derive(Debug, Clone, PartialEq)]
pub struct BusSettings {
    /// How it takes part.
    pub mode: Mode,
    /// Endpoints to connect to, such as `tcp/127.0.0.1:7447`.
    pub connect: Vec<String>,
    /// Endpoints to listen on; TCP port 0 takes a free one.
    pub listen: Vec<String>,
    /// Files for `tls/…` endpoints; a router with them gives every service the rights of its certificate's name.
    pub tls: Option<TlsFiles>,
    /// Whether to look for others by multicast and gossip.
    pub scouting: bool,
    /// Prefix of all keys, if any.
    pub namespace: Option<String>,
    /// After so long without a sign of life a link is closed, in milliseconds; at least 500.
    pub lease_millis: u64,
    /// Entries that the queue of a topic of an episode holds.
    pub queue: usize,
    /// For tests: no push is sent.
    pub drop_pushes: bool,
    /// For tests: the share of pushes that is not sent, 0 to 1.
    pub drop_share: f64,
    /// For tests: seed of the choice.
    pub drop_seed: u64,
}

impl Default for BusSettings {
    fn default() -> Self {
        Self {
            mode: Mode::Peer,
            connect: Vec::new(),
            listen: Vec::new(),
            tls: None,
            scouting: false,
            namespace: None,
            lease_millis: 2_000,
            queue: 256,
            drop_pushes: false,
            drop_share: 0.0,
            drop_seed: 0,
        }
    }
}

impl BusSettings {
    /// Checks the settings and chooses a port where the endpoint leaves it open.
    pub(crate) fn resolved(&self) -> Result<Self, BusError> {
        let refuse =
            |field, value: String, problem: &str| BusError::Setting { field, value, problem: problem.to_owned() };
        if !(0.0..=1.0).contains(&self.drop_share) {
            return Err(refuse("drop_share", self.drop_share.to_string(), "must be 0 to 1"));
        }
        if self.lease_millis < 500 {
            return Err(refuse("lease_millis", self.lease_millis.to_string(), "must be at least 500"));
        }
        if self.queue == 0 {
            return Err(refuse("queue", "0".to_owned(), "must be at least 1"));
        }
        if self.mode == Mode::Client && self.connect.is_empty() {
            return Err(refuse("connect", String::new(), "a client needs a router to connect to"));
        }
        let secured = |endpoint: &&String| endpoint.starts_with("tls/");
        if let Some(endpoint) = self.connect.iter().chain(&self.listen).find(secured)
            && self.tls.is_none()
        {
            return Err(refuse("tls", endpoint.clone(), "needs authority, certificate and key"));
        }
        for (field, endpoints) in [("connect", &self.connect), ("listen", &self.listen)] {
            for endpoint in endpoints {
                if let Err(error) = endpoint.parse::<zenoh::config::EndPoint>() {
                    return Err(refuse(field, endpoint.clone(), &error.to_string()));
                }
            }
        }
        let listen = self.listen.iter().map(|endpoint| with_port(endpoint)).collect::<Result<_, _>>()?;
        Ok(Self { listen, ..self.clone() })
    }

    /// Makes Zenoh's configuration of checked settings.
    pub(crate) fn config(&self) -> Result<Config, BusError> {
        let mut config = Config::default();
        let mut entries = vec![
            ("mode", serde_json::json!(self.mode.name())),
            ("connect/endpoints", serde_json::json!(self.connect)),
            // Whoever cannot reach what it was told to join says so instead of running alone.
            ("connect/timeout_ms", serde_json::json!(CONNECT_MILLIS)),
            ("connect/exit_on_failure", serde_json::json!(true)),
            ("listen/endpoints", serde_json::json!(self.listen)),
            ("scouting/multicast/enabled", serde_json::json!(self.scouting)),
            ("scouting/gossip/enabled", serde_json::json!(self.scouting)),
            ("transport/link/tx/lease", serde_json::json!(self.lease_millis)),
            ("transport/link/tx/queue/size/data", serde_json::json!(16)),
            ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", serde_json::json!(50_000)),
            (
                "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments",
                serde_json::json!(200_000),
            ),
            ("transport/link/rx/max_message_size", serde_json::json!(64 << 20)),
        ];
        if let Some(files) = &self.tls {
            entries.push(("transport/link/tls", files.config()));
            if self.mode == Mode::Router {
                entries.push(("access_control", access::rights()));
            }
        }
        if let Some(namespace) = &self.namespace {
            entries.push(("namespace", serde_json::json!(namespace)));
        }
        for (key, value) in entries {
            config.insert_json5(key, &value.to_string()).map_err(zenoh("take its settings"))?;
        }
        Ok(config)
    }
}

/// Puts a free port in the place of port 0.
fn with_port(endpoint: &str) -> Result<String, BusError> {
    let address = endpoint.split_once('/').filter(|(protocol, _)| ["tcp", "tls"].contains(protocol));
    let Some((protocol, host)) = address.and_then(|(protocol, at)| Some((protocol, at.strip_suffix(":0")?))) else {
        return Ok(endpoint.to_owned());
    };
    let failed = |source| BusError::System { doing: "find a free port", source };
    let port = free_port(host.trim_matches(['[', ']'])).map_err(failed)?;
    Ok(format!("{protocol}/{host}:{port}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(settings: &BusSettings, says: &str) {
        let error = settings.resolved().expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }

    #[test]
    fn wrong_settings_are_refused_by_name() {
        let sound = BusSettings::default();
        assert!(sound.resolved().and_then(|settings| settings.config()).is_ok());
        refused(&BusSettings { drop_share: 1.5, ..sound.clone() }, "drop_share");
        refused(&BusSettings { drop_share: f64::NAN, ..sound.clone() }, "drop_share");
        refused(&BusSettings { lease_millis: 10, ..sound.clone() }, "lease_millis");
        refused(&BusSettings { queue: 0, ..sound.clone() }, "queue");
        refused(&BusSettings { mode: Mode::Client, ..sound.clone() }, "connect");
        refused(&BusSettings { listen: vec!["nonsense".to_owned()], ..sound.clone() }, "listen");
        refused(&BusSettings { listen: vec!["tls/127.0.0.1:0".to_owned()], ..sound }, "tls");
    }

    #[test]
    fn port_zero_becomes_a_free_port() {
        let listen = vec!["tcp/127.0.0.1:0".to_owned()];
        let settings = BusSettings { listen, ..BusSettings::default() }.resolved().expect("sound");
        let port = settings.listen[0].rsplit(':').next().and_then(|port| port.parse::<u16>().ok());
        assert!(port.is_some_and(|port| port > 0), "{:?}", settings.listen);
    }
}
