//! What a process counts, as an HTTP answer for Prometheus: `GET /metrics` on an address of its own, off by default.
//!
//! Counted is what the process has done since it started; nothing of it enters an episode. docs/metrics.md lists every name.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HeaderMap};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use ds_bus::BusSession;
use tonic::Request;
use tonic::metadata::MetadataMap;
use tonic::service::{Interceptor, Routes};
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;

use crate::Drain;
use crate::exposition::{Kind, Page};
use crate::section::{MetricsSection, SecuritySection};
use crate::security::Guard;

/// The format that the text follows.
const FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";
/// How long a scrape may take.
const ANSWER_WITHIN: Duration = Duration::from_secs(10);
/// How long a scrape under way may take after a drain.
const LAST_ANSWER_WITHIN: Duration = Duration::from_secs(1);

type Source = Box<dyn Fn(&mut Page) + Send>;

/// All that the services inside this process count; clones share it.
#[derive(Clone, Default)]
pub struct Metrics(Arc<Mutex<Vec<Source>>>);

impl Metrics {
    /// Adds what every process tells: its service and version, and what its bus session has done.
    pub fn add_process(&self, service: &'static str, bus: &BusSession) {
        let bus = bus.clone();
        self.add(move |page| {
            let built = ("dreamstream_build_info", "Always 1; the labels name service and version.");
            let labels = [("service", service), ("version", env!("CARGO_PKG_VERSION"))];
            page.tell(built.0, built.1, Kind::Gauge, &labels, 1.0);
            for (name, help, count) in bus.counters().list() {
                page.tell(&format!("dreamstream_bus_{name}_total"), help, Kind::Counter, &[], count as f64);
            }
        });
    }

    /// Adds a source, which is asked at each scrape.
    pub fn add(&self, source: impl Fn(&mut Page) + Send + 'static) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(Box::new(source));
    }

    /// Returns the answer to a scrape.
    #[must_use]
    pub fn text(&self) -> String {
        let mut page = Page::default();
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().for_each(|source| source(&mut page));
        page.text()
    }

    /// Opens the address of the settings, by the same rules as the control server's, and returns the task that answers
    /// there until `drain`; without an address it only waits.
    ///
    /// # Errors
    /// If the address is none, in use, or beyond loopback without certificates and token.
    pub fn open(
        &self,
        section: &MetricsSection,
        security: &SecuritySection,
        drain: Drain,
    ) -> Result<impl Future<Output = Result<()>> + Send + use<>> {
        let opened = match section.listen.as_str() {
            "" => None,
            listen => Some(self.listen(listen, security)?),
        };
        Ok(async move {
            let Some((server, incoming)) = opened else {
                drain.cancelled().await;
                return Ok(());
            };
            let stop = drain.clone();
            let served = server.serve_with_incoming_shutdown(incoming, async move { stop.cancelled().await });
            tokio::select! {
                served = served => served.context("metrics"),
                () = async { drain.cancelled().await; tokio::time::sleep(LAST_ANSWER_WITHIN).await } => Ok(()),
            }
        })
    }

    fn listen(
        &self,
        listen: &str,
        security: &SecuritySection,
    ) -> Result<(tonic::transport::server::Router, TcpIncoming)> {
        let address =
            listen.parse().with_context(|| format!("setting \"metrics.listen\" is {listen:?}, not an address"))?;
        let door = security.door("metrics.listen", address)?;
        let incoming = TcpIncoming::bind(address).map_err(|error| anyhow::anyhow!("{error}"));
        let incoming = incoming.with_context(|| format!("metrics: listen on {address}"))?;
        tracing::info!(address = %incoming.local_addr().unwrap_or(address), tls = door.tls.is_some(), "metrics");
        let (metrics, guard) = (self.clone(), door.guard);
        let answer = move |headers: HeaderMap| async move { metrics.answer(headers, guard) };
        let mut server = Server::builder().accept_http1(true).timeout(ANSWER_WITHIN);
        if let Some(tls) = door.tls {
            server = server.tls_config(tls).context("certificate of the metrics")?;
        }
        Ok((server.add_routes(Routes::from(Router::new().route("/metrics", get(answer)))), incoming))
    }

    fn answer(&self, headers: HeaderMap, mut guard: Guard) -> Response {
        let mut request = Request::new(());
        *request.metadata_mut() = MetadataMap::from_headers(headers);
        match guard.call(request) {
            Ok(_) => ([(CONTENT_TYPE, FORMAT)], self.text()).into_response(),
            Err(status) => (StatusCode::UNAUTHORIZED, format!("{}\n", status.message())).into_response(),
        }
    }
}

#[cfg(test)]
mod tests {
    use axum::body::{Body, to_bytes};
    use axum::http;
    use tonic::codegen::Service;
    use tonic::transport::{Certificate, ClientTlsConfig, Endpoint};

    use super::*;
    use crate::certs;

    /// Metrics that are served, where, and what stops them.
    struct Served {
        address: String,
        drain: Drain,
        task: tokio::task::JoinHandle<Result<()>>,
    }

    fn serve(security: &SecuritySection) -> Served {
        let address = format!("127.0.0.1:{}", ds_bus::free_port("127.0.0.1").expect("a free port"));
        let (metrics, drain) = (Metrics::default(), Drain::new());
        metrics.add(|page| page.tell("a_total", "Counted.", Kind::Counter, &[], 7.0));
        let section = MetricsSection { listen: address.clone() };
        let task = tokio::spawn(metrics.open(&section, security, drain.clone()).expect("opens"));
        Served { address, drain, task }
    }

    async fn ask(endpoint: Endpoint, path: &str, token: Option<&str>) -> (StatusCode, String) {
        let mut channel = endpoint.connect().await.expect("answers");
        let mut request = http::Request::get(format!("{}{path}", endpoint.uri().to_string().trim_end_matches('/')));
        if let Some(token) = token {
            request = request.header("authorization", format!("Bearer {token}"));
        }
        let request = request.body(tonic::body::Body::empty()).expect("a request");
        std::future::poll_fn(|context| channel.poll_ready(context)).await.expect("is ready");
        let (head, body) = channel.call(request).await.expect("an answer").into_parts();
        let body = to_bytes(Body::new(body), 1 << 20).await.expect("a body");
        (head.status, String::from_utf8(body.to_vec()).expect("text"))
    }

    #[tokio::test]
    async fn loopback_is_answered_in_clear_until_the_drain() {
        let Served { address, drain, task } = serve(&SecuritySection::default());
        let endpoint = Endpoint::from_shared(format!("http://{address}")).expect("a URI");
        let (status, text) = ask(endpoint.clone(), "/metrics", None).await;
        assert_eq!(
            (status, text.as_str()),
            (StatusCode::OK, "# HELP a_total Counted.\n# TYPE a_total counter\na_total 7\n")
        );
        assert_eq!(ask(endpoint, "/", None).await.0, StatusCode::NOT_FOUND);
        drain.cancel();
        task.await.expect("no panic").expect("ends in order");
        assert!(std::net::TcpStream::connect(address).is_err(), "it still listens");
    }

    #[tokio::test]
    async fn certificates_and_token_hold_here_too() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let wanted = certs::Wanted { folder: folder.path(), policies: &[], hosts: &[], days: 1 };
        certs::make(&wanted).expect("certificates");
        let file = |name: &str| folder.path().join(name);
        let security = SecuritySection {
            ca: file("ca.pem"),
            certificate: file("sim-server.pem"),
            key: file("sim-server.key"),
            token: file("token"),
            insecure: false,
        };
        let Served { address, .. } = serve(&security);
        let authority = Certificate::from_pem(std::fs::read(file("ca.pem")).expect("a file"));
        let tls = ClientTlsConfig::new().ca_certificate(authority);
        let endpoint =
            Endpoint::from_shared(format!("https://{address}")).expect("a URI").tls_config(tls).expect("TLS");
        let token = std::fs::read_to_string(file("token")).expect("a file");
        assert_eq!(ask(endpoint.clone(), "/metrics", Some(token.trim())).await.0, StatusCode::OK);
        for wrong in [None, Some("0123456789abcdef")] {
            let (status, text) = ask(endpoint.clone(), "/metrics", wrong).await;
            assert_eq!((status, text.contains("a_total")), (StatusCode::UNAUTHORIZED, false), "{text}");
        }
        let clear = Endpoint::from_shared(format!("http://{address}")).expect("a URI");
        let answered = match clear.connect().await {
            Ok(mut channel) => {
                let ready = std::future::poll_fn(|context| channel.poll_ready(context)).await;
                let request = http::Request::get(format!("http://{address}/metrics")).body(tonic::body::Body::empty());
                ready.is_ok() && channel.call(request.expect("a request")).await.is_ok()
            }
            Err(_) => false,
        };
        assert!(!answered, "it answers in clear");
    }

    #[tokio::test]
    async fn nothing_beyond_loopback_in_clear_and_no_address_that_is_none() {
        for (listen, says) in [("0.0.0.0:0", "beyond loopback"), ("nonsense", "not an address")] {
            let section = MetricsSection { listen: listen.to_owned() };
            let opened = Metrics::default().open(&section, &SecuritySection::default(), Drain::new());
            let error = opened.err().expect("refused").to_string();
            assert!(error.contains(says) && error.contains("metrics.listen"), "{error}");
        }
    }
}
