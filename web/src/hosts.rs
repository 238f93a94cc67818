//! The names by which browsers may ask for the page.
//!
//! A foreign page may let its own name lead to this address (DNS rebinding), and could then read the answers as its
//! own. The browser says by which name it asks. So this program accepts only names that no foreign page can have:
//! addresses, `localhost`, and the names that the command line gives.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::HOST;
use axum::http::uri::Authority;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// The answer to a request by another name.
const REFUSAL: &str =
    "refused: ask by the address, by localhost, or by a name that pmac-web was started with (--host NAME)\n";

/// The names that the page has besides its address.
#[derive(Debug, Clone, Default)]
pub struct Hosts(Arc<[String]>);

impl Hosts {
    /// `names`, without ports.
    #[must_use]
    pub fn new(names: &[String]) -> Self {
        Self(names.into())
    }

    /// Whether `host`, from a `Host` header, is a name of the page.
    fn has(&self, host: &str) -> bool {
        let Ok(authority) = host.parse::<Authority>() else { return false };
        let name = authority.host().trim_end_matches('.');
        let address = name.trim_start_matches('[').trim_end_matches(']');
        address.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.0.iter().any(|own| name.eq_ignore_ascii_case(own))
    }
}

/// Refuses a request by another name.
pub async fn check(State(hosts): State<Hosts>, request: Request, next: Next) -> Response {
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok());
    match host {
        Some(host) if hosts.has(host) => next.run(request).await,
        _ => (StatusCode::MISDIRECTED_REQUEST, REFUSAL).into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_addresses_and_own_names_count() {
        let hosts = Hosts::new(&["rig1.example".to_owned()]);
        for own in [
            "127.0.0.1",
            "127.0.0.1:8025",
            "[::1]:8025",
            "192.168.0.7",
            "localhost",
            "LocalHost:8025",
            "localhost.",
            "rig1.example",
            "RIG1.example.:80",
        ] {
            assert!(hosts.has(own), "{own}");
        }
        for other in [
            "evil.example",
            "127.0.0.1.evil.example",
            "localhost.evil.example",
            "localhost@evil.example",
            "rig1",
            "a.rig1.example",
            "2130706433",
            "",
            ":8025",
            "localhost/",
        ] {
            assert!(!hosts.has(other), "{other}");
        }
    }
}
