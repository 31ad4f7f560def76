//! Pictures under `/pictures`: comparison with a recording, curves of measured models.

use axum::Router;
use axum::body::Bytes;
use axum::http::header::CONTENT_TYPE;
use axum::routing::get;

/// A picture with its title.
#[derive(Clone, Debug)]
pub struct Picture {
    pub title: String,
    /// `image/svg+xml` or `image/png`.
    pub kind: &'static str,
    /// Bytes of the file.
    pub content: Bytes,
}

/// Adds their list and the pictures.
pub fn routes<S: Clone + Send + Sync + 'static>(mut router: Router<S>, pictures: &[Picture]) -> Router<S> {
    for (index, picture) in pictures.iter().enumerate() {
        let answer = ([(CONTENT_TYPE, picture.kind)], picture.content.clone());
        router = router.route(&path(index), get(move || async move { answer.clone() }));
    }
    let answer = ([(CONTENT_TYPE, "text/html; charset=utf-8")], page(pictures));
    router.route("/pictures", get(move || async move { answer.clone() }))
}

fn path(index: usize) -> String {
    format!("/pictures/{index}")
}

fn page(pictures: &[Picture]) -> String {
    let head = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><link rel=\"icon\" href=\"data:,\"><title>softtwin pictures</title>\
                <body style=\"font-family: sans-serif\"><a href=\"/\">live view</a>";
    let one = |(index, picture): (usize, &Picture)| {
        let title = picture.title.replace('&', "&amp;").replace('<', "&lt;");
        format!("<h2>{title}</h2><img src=\"{}\" alt=\"\" style=\"max-width: 100%\">", path(index))
    };
    head.to_owned() + &pictures.iter().enumerate().map(one).collect::<String>()
}
