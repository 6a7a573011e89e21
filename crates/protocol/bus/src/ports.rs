//! Ports that somebody is told of before anybody listens there.

use std::io::{Error, ErrorKind, Result};
use std::net::TcpListener;
use std::sync::atomic::{AtomicU16, Ordering};

/// Beneath every system's range for outgoing connections, which would take a port between its choice and its use.
const FIRST: u16 = 16_384;
const PORTS: u16 = 16_384;
/// A process begins apart from others; two choices of one process are apart.
const APART: u32 = 2_654_435_761;
static CHOSEN: AtomicU16 = AtomicU16::new(0);

/// Returns a port at which nobody listens on `host`; of one process never the same twice in 16,384 calls.
///
/// # Errors
/// If `host` is no address of this machine, or all ports are taken.
pub fn free_port(host: &str) -> Result<u16> {
    let start = std::process::id().wrapping_mul(APART) >> 16;
    for _ in 0..PORTS {
        let next = start.wrapping_add(u32::from(CHOSEN.fetch_add(1, Ordering::Relaxed)));
        let port = FIRST + u16::try_from(next % u32::from(PORTS)).unwrap_or_default();
        match TcpListener::bind((host, port)) {
            Ok(_) => return Ok(port),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {}
            Err(error) => return Err(error),
        }
    }
    Err(Error::new(ErrorKind::AddrInUse, format!("all ports from {FIRST} to {} are taken", FIRST + PORTS - 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_free_beneath_those_of_outgoing_connections_and_never_given_twice() {
        let (one, other) = (free_port("127.0.0.1").expect("a port"), free_port("127.0.0.1").expect("a port"));
        assert_ne!(one, other);
        for port in [one, other] {
            assert!((FIRST..FIRST + PORTS).contains(&port), "{port}");
            TcpListener::bind(("127.0.0.1", port)).expect("is free");
        }
        free_port("203.0.113.7").expect_err("an address of another machine");
    }
}
