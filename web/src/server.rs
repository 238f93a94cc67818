//! HTTP within bounds: on connections, on the time for a request, and on the time that a client may not read.

use std::convert::Infallible;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::middleware::from_fn_with_state;
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_util::{Stream, StreamExt, stream};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use log::warn;
use serde::Deserialize;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::sync::broadcast::error::RecvError;
use tokio_io_timeout::TimeoutStream;

use crate::board::Place;
use crate::feed::Feed;
use crate::hosts::{self, Hosts};
use crate::places::{Place as Held, Places};
use crate::scope::Traces;
use crate::{metrics, pages};

/// Connections at a time. When all are taken, the server closes the one that has been idle the longest for a new one;
/// if none is idle, the new one waits.
pub const CONNECTIONS: usize = 64;
/// Streams at a time, of state or of traces: fewer than the connections, so that other clients get in.
pub const STREAMS: usize = 48;
/// How long a client may take for a request, and stay without one.
const REQUEST: Duration = Duration::from_secs(10);
/// How long a client may stay without a request when all places are taken.
const IDLE_WHEN_FULL: Duration = Duration::from_secs(1);
/// How long such a client may still fetch its last answer.
const LAST_ANSWER: Duration = Duration::from_secs(1);
/// How long a client may not read.
const UNREAD: Duration = Duration::from_secs(10);
/// The most bytes of a request that the server keeps.
const REQUEST_MAX: usize = 16 << 10;
/// How long the server waits after the system refused a connection.
const REFUSED: Duration = Duration::from_millis(100);

#[derive(Clone)]
struct Site {
    feed: Feed,
    place: Arc<Place>,
    streams: Arc<Semaphore>,
}

/// All answers to requests by one of the `hosts`.
pub fn routes(feed: Feed, place: Place, hosts: Hosts) -> Router {
    let site = Site { feed, place: Arc::new(place), streams: Arc::new(Semaphore::new(STREAMS)) };
    let own = Router::new()
        .route("/state", get(state))
        .route("/events", get(events))
        .route("/scope", get(scope))
        .route("/metrics", get(numbers));
    own.merge(pages::routes()).with_state(site).layer(from_fn_with_state(hosts, hosts::check))
}

/// Serves until the program ends.
pub async fn serve(listener: TcpListener, routes: Router) {
    let places = Places::new(CONNECTIONS, IDLE_WHEN_FULL);
    loop {
        match listener.accept().await {
            Ok((stream, _)) => drop(tokio::spawn(connection(stream, routes.clone(), places.take().await))),
            Err(why) => {
                warn!("a connection: {why}");
                tokio::time::sleep(REFUSED).await;
            }
        }
    }
}

async fn connection(stream: TcpStream, routes: Router, place: Held) {
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(UNREAD));
    let (routes, place) = (TowerToHyperService::new(routes), Arc::new(place));
    let asked = Arc::clone(&place);
    let service = service_fn(move |request| {
        asked.asks();
        let (response, asked) = (routes.call(request), Arc::clone(&asked));
        async move {
            let response = response.await;
            // A stream has no end, and is never idle.
            let is_stream = |response: &Response| {
                response.headers().get(CONTENT_TYPE).is_some_and(|kind| kind == "text/event-stream")
            };
            if !response.as_ref().is_ok_and(is_stream) {
                asked.is_answered();
            }
            response
        }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(REQUEST)
        .max_buf_size(REQUEST_MAX)
        .serve_connection(TokioIo::new(Box::pin(stream)), service);
    let mut served = pin!(served);
    tokio::select! {
        // A client that leaves is no fault of the server.
        _ = served.as_mut() => return,
        () = place.is_lost() => {}
    }
    served.as_mut().graceful_shutdown();
    let _ = tokio::time::timeout(LAST_ANSWER, served).await;
}

async fn state(State(site): State<Site>) -> Response {
    let json = site.feed.state.borrow().to_string();
    ([(CONTENT_TYPE, "application/json"), (CACHE_CONTROL, "no-store")], json).into_response()
}

async fn numbers(State(site): State<Site>) -> Response {
    // Attaching reads files.
    let read = tokio::task::spawn_blocking(move || metrics::text(&site.place)).await;
    match read {
        Ok(Ok(text)) => ([(CONTENT_TYPE, metrics::KIND)], text).into_response(),
        Ok(Err(why)) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{why}\n")).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// Streams the `events`, if the server has room for one more stream.
fn streamed(site: &Site, events: impl Stream<Item = String> + Send + 'static) -> Response {
    let Ok(place) = Arc::clone(&site.streams).try_acquire_owned() else {
        let why = format!("{STREAMS} clients are shown the board: close one, or try again later\n");
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    let events = events.map(move |json| {
        let _held = &place;
        Ok::<_, Infallible>(Event::default().data(json))
    });
    Sse::new(events).into_response()
}

/// Streams each new state.
async fn events(State(site): State<Site>) -> Response {
    let states = stream::unfold((site.feed.state.clone(), true), |(mut states, is_first)| async move {
        if !is_first {
            states.changed().await.ok()?;
        }
        let state = states.borrow_and_update().to_string();
        Some((state, (states, false)))
    });
    streamed(&site, states)
}

#[derive(Deserialize)]
struct Asked {
    traces: String,
}

/// Streams every servo update of the requested traces.
async fn scope(State(site): State<Site>, Query(asked): Query<Asked>) -> Response {
    let traces = match Traces::parse(&asked.traces) {
        Ok(traces) => traces,
        Err(why) => return (StatusCode::BAD_REQUEST, format!("{why}\n")).into_response(),
    };
    let batches = stream::unfold((site.feed.batches(), traces), |(mut batches, traces)| async move {
        let json = match batches.recv().await {
            Ok(batch) => traces.json(&batch),
            // Too slow: the picture says so.
            Err(RecvError::Lagged(batches)) => format!("{{\"t\":[],\"v\":[],\"behind\":{batches}}}"),
            Err(RecvError::Closed) => return None,
        };
        Some((json, (batches, traces)))
    });
    streamed(&site, batches)
}
