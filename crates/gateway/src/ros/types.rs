//! Types of ROS 2 in keys and tokens.

/// A type: its name in keys and the hash of its description.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageType {
    /// Name, such as `geometry_msgs::msg::dds_::WrenchStamped_`.
    pub name: &'static str,
    /// `RIHS01_` and the hash, the same in all releases since Iron.
    pub hash: &'static str,
}

impl MessageType {
    /// Checks that a key of the other side ends in this type's hash.
    ///
    /// # Errors
    /// Another hash.
    pub fn check_hash(self, key: &str) -> Result<(), String> {
        if key.ends_with(self.hash) {
            return Ok(());
        }
        Err(format!("{key}: expected type hash {}; build the other side with ROS 2 Iron or later", self.hash))
    }
}

/// `geometry_msgs/msg/WrenchStamped`.
pub const WRENCH: MessageType = MessageType {
    name: "geometry_msgs::msg::dds_::WrenchStamped_",
    hash: "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
};
/// `sensor_msgs/msg/PointCloud2`.
pub const POINTS: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::PointCloud2_",
    hash: "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
};
/// `visualization_msgs/msg/Marker`.
pub const MARKER: MessageType = MessageType {
    name: "visualization_msgs::msg::dds_::Marker_",
    hash: "RIHS01_45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0",
};
/// `sensor_msgs/msg/FluidPressure`.
pub const PRESSURE: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::FluidPressure_",
    hash: "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
};
/// `sensor_msgs/msg/JointState`.
pub const JOINTS: MessageType = MessageType {
    name: "sensor_msgs::msg::dds_::JointState_",
    hash: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
};
/// `std_msgs/msg/Float64MultiArray`.
pub const COMMANDS: MessageType = MessageType {
    name: "std_msgs::msg::dds_::Float64MultiArray_",
    hash: "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
};
/// `diagnostic_msgs/msg/DiagnosticArray`.
pub const DIAGNOSTICS: MessageType = MessageType {
    name: "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    hash: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
};
/// `std_srvs/srv/Trigger`.
pub const TRIGGER: MessageType = MessageType {
    name: "std_srvs::srv::dds_::Trigger_",
    hash: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
};
/// `softtwin_interfaces/srv/WhatIf`; see clients/ros2/softtwin_interfaces.
pub const WHAT_IF: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::WhatIf_",
    hash: "RIHS01_9f2ac41aea00462ce74df4a6e79b64f152cb2f5a016da59b01275b0881aff29c",
};
/// `softtwin_interfaces/srv/FindPressure`.
pub const FIND_PRESSURE: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::FindPressure_",
    hash: "RIHS01_02039dd0399fb01b07e8dc294ae3685b5ea0a0704c03a5bcf02707eb91d25eb0",
};
/// `softtwin_interfaces/srv/FindGap`.
pub const FIND_GAP: MessageType = MessageType {
    name: "softtwin_interfaces::srv::dds_::FindGap_",
    hash: "RIHS01_67eb9215946c75657692c55fb03354a965e0a6d2839b1253e1cbd4f0bf6efa05",
};
