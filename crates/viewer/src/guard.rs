//! Who may see the browser. On loopback: this machine only. Elsewhere: who has the token.

use anyhow::{Result, anyhow};
use axum::http::{HeaderMap, Uri, header};
use runtime::http::is_this_machine;
use std::net::IpAddr;

/// Name of the cookie that carries the token after the first page.
const COOKIE: &str = "softtwin_token";

/// The rule for one server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Guard {
    /// Bound to loopback: a name that is not this machine's in `Host`, or a foreign page in `Origin`, is refused.
    /// (Otherwise any page in the user's browser could read the twin.)
    Loopback,
    /// Bound elsewhere: the token is needed.
    Token(String),
}

impl Guard {
    /// Loopback needs no token; elsewhere the given one or a fresh random one is used.
    ///
    /// # Errors
    /// When no random bytes can be had.
    pub fn new(address: IpAddr, token: Option<String>) -> Result<Self> {
        match token {
            Some(token) => Ok(Self::Token(token)),
            None if address.is_loopback() => Ok(Self::Loopback),
            None => Ok(Self::Token(random_token()?)),
        }
    }

    /// The token, if one is needed.
    pub fn token(&self) -> Option<&str> {
        match self {
            Self::Loopback => None,
            Self::Token(token) => Some(token),
        }
    }

    /// Whether a request is allowed; the text says why not.
    ///
    /// # Errors
    /// The refusal for the user.
    pub fn check(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), &'static str> {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(header::HOST).unwrap_or("");
        let foreign = text(header::ORIGIN).is_some_and(|origin| origin.split("://").nth(1) != Some(host));
        if foreign {
            return Err("a page of another site asked; open softtwin view itself");
        }
        match self {
            Self::Loopback if is_this_machine(host) => Ok(()),
            Self::Loopback => {
                Err("this viewer answers on localhost only; start it with --bind to open it to others")
            }
            Self::Token(token) => {
                let given = query_token(uri).or_else(|| text(header::COOKIE).and_then(cookie_token));
                if given.is_some_and(|given| same(given, token)) {
                    Ok(())
                } else {
                    Err("the token is missing or wrong; use the whole address that softtwin view printed")
                }
            }
        }
    }

    /// The cookie to set on the first page, so that its parts load without the token in their address.
    pub fn cookie(&self) -> Option<String> {
        self.token().map(|token| format!("{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"))
    }
}

fn query_token(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

fn cookie_token(cookies: &str) -> Option<&str> {
    cookies.split(';').find_map(|cookie| cookie.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

/// Compares without stopping at the first difference, so that the time it takes gives no hint.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |sum, (x, y)| sum | (x ^ y)) == 0
}

fn random_token() -> Result<String> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)
        .map_err(|error| anyhow!("no random bytes for a token ({error}); give one with --token"))?;
    Ok(wire::layout::hex(&bytes))
}

#[cfg(test)]
#[path = "../tests/unit/guard.rs"]
mod tests;
