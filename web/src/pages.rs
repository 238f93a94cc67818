//! The files of the page. They are part of the program.

use axum::Router;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, X_CONTENT_TYPE_OPTIONS};
use axum::routing::get;

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
/// The page loads what this program has, and nothing else.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'";

/// The page, its scripts and its styles.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let files = [
        ("/", HTML, include_str!("../page/index.html")),
        ("/page.js", SCRIPT, include_str!("../page/page.js")),
        ("/scope.js", SCRIPT, include_str!("../page/scope.js")),
        ("/page.css", STYLE, include_str!("../page/page.css")),
        ("/uPlot.js", SCRIPT, include_str!("../page/uPlot.iife.min.js")),
        ("/uPlot.css", STYLE, include_str!("../page/uPlot.min.css")),
    ];
    files.into_iter().fold(Router::new(), |router, (path, kind, text)| {
        let headers = [
            (CONTENT_TYPE, kind),
            (CACHE_CONTROL, "no-cache"),
            (CONTENT_SECURITY_POLICY, POLICY),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        ];
        router.route(path, get(move || async move { (headers, text) }))
    })
}
