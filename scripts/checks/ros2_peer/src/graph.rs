//! Content of hiroz' graph.

use crate::ros::softtwin_interfaces::srv::{FindGap, FindPressure, WhatIf};
use crate::stage::{Seen, Stage, ensure, until};
use hiroz::entity::EndpointKind;
use hiroz::qos::QosProfile;
use hiroz::{MessageTypeInfo, ServiceTypeInfo, TypeInfo};
use hiroz_msgs::ros::diagnostic_msgs::DiagnosticArray;
use hiroz_msgs::ros::geometry_msgs::WrenchStamped;
use hiroz_msgs::ros::sensor_msgs::{FluidPressure, PointCloud2};
use hiroz_msgs::ros::std_srvs::srv::Trigger;
use hiroz_msgs::ros::visualization_msgs::Marker;
use std::process::Command;

/// Name of the node in the gateway's configuration.
pub const NODE: &str = "twins";

/// The node, once.
pub fn node(stage: &Stage) -> Seen {
    until(|| {
        let nodes = stage.node.graph().get_node_names();
        let count = nodes.iter().filter(|(name, namespace)| name == NODE && namespace == "/").count();
        ensure(count == 1, || format!("expected one node /{NODE}, found {nodes:?}"))
    })?;
    Ok(format!("/{NODE}"))
}

/// Nothing of the node is left when its program has ended.
pub fn gone(stage: &Stage) -> Seen {
    node(stage)?;
    let process = stage.text("gateway.pid")?;
    let ended = Command::new("kill").arg(process.trim()).status()?;
    ensure(ended.success(), || format!("kill {process}: {ended}"))?;
    let node = (String::new(), NODE.to_owned());
    until(|| {
        let graph = stage.node.graph();
        let kinds = [EndpointKind::Publisher, EndpointKind::Subscription, EndpointKind::Service];
        let left: usize = kinds.map(|kind| graph.get_entities_by_node(kind, node.clone()).len()).iter().sum();
        let nodes = graph.get_node_names();
        let is_gone = left == 0 && nodes.iter().all(|(name, _)| name != NODE);
        ensure(is_gone, || format!("{left} endpoints are left; nodes: {nodes:?}"))
    })?;
    Ok("node, topics and services".into())
}

/// The topics that the gateway publishes.
pub fn publishers(stage: &Stage) -> Seen {
    let mut expected = Vec::new();
    for actuator in ["finger", "fed"] {
        expected.push((format!("/softtwin/{actuator}/wrench"), WrenchStamped::type_info()));
        expected.push((format!("/softtwin/{actuator}/pressure"), FluidPressure::type_info()));
        expected.push((format!("/softtwin/{actuator}/diagnostics"), DiagnosticArray::type_info()));
    }
    expected.push(("/softtwin/finger/surface/points".into(), PointCloud2::type_info()));
    expected.push(("/softtwin/finger/surface/marker".into(), Marker::type_info()));
    find(stage, EndpointKind::Publisher, &expected)
}

/// The topic that the gateway subscribes to.
pub fn subscriptions(stage: &Stage) -> Seen {
    let expected = [("/softtwin/fed/pressure_measured".into(), FluidPressure::type_info())];
    find(stage, EndpointKind::Subscription, &expected)
}

/// Services whose types hiroz has; those of parameters are called by its client.
pub fn services(stage: &Stage) -> Seen {
    let types = [
        ("describe", Trigger::service_type_info()),
        ("what_if", WhatIf::service_type_info()),
        ("find_pressure", FindPressure::service_type_info()),
        ("find_gap", FindGap::service_type_info()),
    ];
    let of = |actuator: &str| {
        let named = types.iter().map(|(name, of)| (format!("/softtwin/{actuator}/{name}"), of.clone()));
        named.collect::<Vec<_>>()
    };
    find(stage, EndpointKind::Service, &[of("finger"), of("fed")].concat())
}

/// Waits until the node has all of these; type and hash are compared with those that hiroz computes from the definitions, QoS with what
/// its own endpoints have.
fn find(stage: &Stage, kind: EndpointKind, expected: &[(String, TypeInfo)]) -> Seen {
    let node = (String::new(), NODE.to_owned());
    let qos = QosProfile::default().to_protocol_qos();
    until(|| {
        let found = stage.node.graph().get_entities_by_node(kind, node.clone());
        for (name, of) in expected {
            let one = found.iter().find(|endpoint| endpoint.topic == *name);
            let one = one.ok_or_else(|| format!("{name} is not among the {} found", found.len()))?;
            ensure(one.type_info.as_ref() == Some(of), || {
                format!("{name}: expected {} {}, found {:?}", of.name, of.hash, one.type_info)
            })?;
            ensure(one.qos == qos, || format!("{name}: expected {qos:?}, found {:?}", one.qos))?;
        }
        Ok(format!("{} as hiroz has them, {} in all", expected.len(), found.len()))
    })
}
