//! Keys and tokens, as the design document of `rmw_zenoh` (docs/design.md there, "Topic and Service name mapping" and "Graph
//! Cache") has them.

use super::config::Ros2;
use super::types::MessageType;
use crate::link::{Link, network};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;

/// QoS of all endpoints in tokens: reliable, volatile, keep the last 10 (the default of ROS).
const QOS: &str = "::,10:,:,:,,";

/// Kind of an endpoint in tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entity {
    Publisher,
    Subscription,
    /// A service server.
    Service,
}

impl Entity {
    fn code(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
            Self::Service => "SS",
        }
    }
}

/// Keys and tokens of one node.
pub struct Names<'a> {
    ros: &'a Ros2,
    session_id: String,
}

impl Names<'_> {
    /// Names of a node in this session.
    pub fn new<'a>(ros: &'a Ros2, link: &Link) -> Names<'a> {
        Names { ros, session_id: link.session.zid().to_string() }
    }

    /// Key of a topic or service.
    pub fn key(&self, topic: &str, of: MessageType, hash: &str) -> String {
        format!("{}/{topic}/{}/{hash}", self.ros.domain_id, of.name)
    }

    /// The token of the node.
    pub fn node(&self) -> String {
        self.entity(0, "NN")
    }

    fn entity(&self, number: usize, code: &str) -> String {
        let (domain, session, node) = (self.ros.domain_id, &self.session_id, &self.ros.node);
        format!("@ros2_lv/{domain}/{session}/0/{number}/{code}/%/%/{node}")
    }

    /// The token of an endpoint; `number` is its own within the node.
    pub fn endpoint(&self, number: usize, entity: Entity, topic: &str, of: MessageType) -> String {
        let mangled = topic.replace('/', "%");
        format!("{}/%{mangled}/{}/{}/{QOS}", self.entity(number, entity.code()), of.name, of.hash)
    }
}

/// Makes an entity appear in the graph while the result exists.
///
/// # Errors
/// When the session is closed.
pub fn token(link: &Link, key: String) -> anyhow::Result<LivelinessToken> {
    network(link.session.liveliness().declare_token(key).wait())
}
