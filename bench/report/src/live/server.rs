//! The server of the live view: a browser can read the page and its events, and can change nothing.

use std::convert::Infallible;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use futures_util::stream;

use super::hub::Hub;

/// Headers of every answer: browsers do not store it, the page loads nothing from other hosts, and no other page can
/// embed it.
const HEADERS: [(HeaderName, &str); 4] = [
    (header::CACHE_CONTROL, "no-store"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// The page and the events that the server sends.
#[derive(Clone, Debug)]
pub(super) struct Served {
    page: Arc<str>,
    /// The id of each event, a digest of the page. A browser that reconnects sends it back.
    digest: Arc<str>,
    pub(super) hub: Arc<Mutex<Hub>>,
}

impl Served {
    /// Creates the state of a page without events.
    pub(super) fn new(page: &str) -> Self {
        let mut hasher = DefaultHasher::new();
        page.hash(&mut hasher);
        Self { page: page.into(), digest: format!("{:016x}", hasher.finish()).into(), hub: Arc::default() }
    }

    pub(super) fn hub(&self) -> MutexGuard<'_, Hub> {
        self.hub.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the routes.
pub(super) fn routes(served: Served) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/events", get(events))
        .layer(middleware::from_fn(only_this_machine))
        .with_state(served)
}

async fn page(State(served): State<Served>) -> Html<String> {
    Html(served.page.to_string())
}

/// Sends the state, then each change, as server-sent events. A page that another run served gets an event that makes it
/// load this run's page.
async fn events(State(served): State<Served>, headers: HeaderMap) -> Response {
    if headers.get("last-event-id").is_some_and(|last| last.as_bytes() != served.digest.as_bytes()) {
        let reload = stream::iter([Ok::<_, Infallible>(
            Event::default().event("other-run").data("load this page again"),
        )]);
        return Sse::new(reload).into_response();
    }
    let Some(parts) = served.hub().open() else {
        let text = "too many pages show this run: close one of them\n";
        return (StatusCode::SERVICE_UNAVAILABLE, text).into_response();
    };
    let events = stream::unfold((parts, served.digest), |(mut parts, digest)| async {
        let text = parts.recv().await?;
        Some((Ok::<_, Infallible>(Event::default().id(&*digest).data(text)), (parts, digest)))
    });
    Sse::new(events).keep_alive(KeepAlive::default()).into_response()
}

/// Refuses what a foreign page asks a browser on this machine for.
///
/// A name of its own that leads to 127.0.0.1 would make our page part of the foreign page's origin ("DNS rebinding"), so
/// `Host` has to name the loopback. And a foreign page may not keep our events open.
async fn only_this_machine(request: Request, next: Next) -> Response {
    let mut response = match refusal(request.headers()) {
        Some(text) => (StatusCode::FORBIDDEN, text).into_response(),
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, axum::http::HeaderValue::from_static(value));
    }
    response
}

/// Returns why a request is refused.
fn refusal(headers: &HeaderMap) -> Option<&'static str> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    if !text(header::HOST).is_some_and(is_loopback) {
        return Some("this page is only for the machine that measures: open it by 127.0.0.1 or localhost\n");
    }
    // A link from elsewhere may open the page; its scripts may not read from us.
    let [site, mode] =
        ["sec-fetch-site", "sec-fetch-mode"].map(|name| headers.get(name).map(|value| value.as_bytes()));
    let is_foreign = site.is_some_and(|site| site != b"same-origin" && site != b"none");
    (is_foreign && mode != Some(b"navigate")).then_some("this page answers its own scripts only\n")
}

/// Returns whether a `Host` names the loopback.
fn is_loopback(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.parse::<u16>().is_ok() => name,
        _ => host,
    };
    let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost")
        || address.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;
    use axum::http::Method;
    use tower_service::Service as _;

    fn ask(method: Method, path: &str, headers: &[(&str, &str)]) -> Response {
        let served = Served::new("the page");
        let request = Request::builder().method(method).uri(path);
        let request = headers.iter().fold(request, |request, (name, value)| request.header(*name, *value));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(routes(served).call(request.body(Body::empty()).unwrap())).unwrap()
    }

    #[test]
    fn only_get_is_answered_and_only_of_the_page_and_its_events() {
        let local = [("host", "127.0.0.1:8642")];
        for path in ["/", "/events"] {
            assert_eq!(ask(Method::GET, path, &local).status(), StatusCode::OK, "{path}");
            for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH, Method::OPTIONS] {
                let status = ask(method.clone(), path, &local).status();
                assert_eq!(status, StatusCode::METHOD_NOT_ALLOWED, "{method} {path}");
            }
        }
        assert_eq!(ask(Method::GET, "/results.json", &local).status(), StatusCode::NOT_FOUND);
    }

    /// Returns the first bytes of the events that a page gets which asks again.
    fn events_after(last: &str) -> String {
        use futures_util::StreamExt as _;
        let answer = ask(Method::GET, "/events", &[("host", "localhost"), ("last-event-id", last)]);
        let mut body = answer.into_body().into_data_stream();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let first = runtime.block_on(body.next()).unwrap().unwrap();
        String::from_utf8(first.to_vec()).unwrap()
    }

    #[test]
    fn a_page_of_another_run_is_told_to_load_this_ones_and_one_of_this_run_gets_the_state() {
        let digest = Served::new("the page").digest;
        let state = events_after(&digest);
        assert!(state.contains("\"is_whole\":true") && state.contains(&format!("id: {digest}")), "{state}");
        let other = events_after(&Served::new("another page").digest);
        assert!(other.contains("event: other-run") && !other.contains("is_whole"), "{other}");
    }

    #[test]
    fn a_host_that_is_not_the_loopback_is_refused_so_that_a_name_of_a_foreign_page_does_not_help() {
        for host in
            ["127.0.0.1:8642", "127.0.0.1", "localhost:80", "LOCALHOST", "[::1]:8642", "[::1]", "127.1.2.3:9"]
        {
            assert_eq!(ask(Method::GET, "/", &[("host", host)]).status(), StatusCode::OK, "{host}");
        }
        for host in [
            "evil.example:8642",
            "localhost.evil.example",
            "10.0.0.1:8642",
            "127.0.0.1.evil.example",
            "",
            "[::2]:8642",
        ] {
            assert_eq!(
                ask(Method::GET, "/events", &[("host", host)]).status(),
                StatusCode::FORBIDDEN,
                "{host}"
            );
        }
        assert_eq!(ask(Method::GET, "/", &[]).status(), StatusCode::FORBIDDEN);
    }

    #[test]
    fn scripts_of_a_foreign_page_get_nothing_and_a_link_from_one_opens_the_page() {
        let from = |site, mode| {
            ask(
                Method::GET,
                "/",
                &[("host", "localhost"), ("sec-fetch-site", site), ("sec-fetch-mode", mode)],
            )
            .status()
        };
        assert_eq!(from("same-origin", "cors"), StatusCode::OK);
        assert_eq!(from("none", "navigate"), StatusCode::OK);
        assert_eq!(from("cross-site", "navigate"), StatusCode::OK);
        assert_eq!(from("cross-site", "no-cors"), StatusCode::FORBIDDEN);
        assert_eq!(from("same-site", "cors"), StatusCode::FORBIDDEN);
    }

    #[test]
    fn every_answer_forbids_storing_foreign_sources_and_frames() {
        for host in ["localhost", "evil.example"] {
            let answer = ask(Method::GET, "/", &[("host", host)]);
            let text = |name: HeaderName| answer.headers()[name].to_str().unwrap().to_owned();
            assert_eq!(text(header::CACHE_CONTROL), "no-store");
            let policy = text(header::CONTENT_SECURITY_POLICY);
            assert!(
                policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"),
                "{policy}"
            );
        }
    }
}
