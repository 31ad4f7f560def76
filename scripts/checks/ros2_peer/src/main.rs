//! A node of ROS 2 with an independent implementation: `hiroz` joins as another process and checks what it receives from the gateway. Types are its
//! own, from the definitions that it ships and from those in clients/ros2. Started by scripts/check.sh ros2-peer, which starts the twins.
//!
//!   ros2-peer router ENDPOINT      a router with the settings of ROS, until it is killed
//!   ros2-peer ENDPOINT FOLDER      all checks; FOLDER holds what our own programs say: states.jsonl, fields.jsonl, whatif.json, gateway.log

#![allow(unexpected_cfgs)] // of generated code

mod fields;
mod graph;
mod heard;
mod other_hash;
mod parameters;
mod pressure;
mod services;
mod stage;
mod states;

/// Named by generated code.
pub use hiroz_msgs::size_estimation;

// The types of clients/ros2/softtwin_interfaces; see build.rs.
include!(concat!(env!("OUT_DIR"), "/generated.rs"));

use stage::{Error, Seen, Stage};
use std::process::ExitCode;

type Check = fn(&Stage) -> Seen;

/// In this order: what comes last must not be disturbed by what came before.
const CHECKS: [(&str, Check); 14] = [
    ("node in the graph", graph::node),
    ("published topics with types and hashes", graph::publishers),
    ("subscribed topics with types and hashes", graph::subscriptions),
    ("services with types and hashes", graph::services),
    ("WrenchStamped and FluidPressure", states::wrench_and_pressure),
    ("PointCloud2 and Marker", fields::cloud_and_marker),
    ("DiagnosticArray", states::diagnostics),
    ("FluidPressure to the twin", pressure::the_twin_follows),
    ("service describe", services::describe),
    ("services of questions", services::questions),
    ("parameters", parameters::all),
    ("another type hash is named in the log", other_hash::is_named),
    ("nothing broke by it", other_hash::breaks_nothing),
    ("gone with its program", graph::gone),
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match arguments[..] {
        ["router", endpoint] => route(endpoint),
        [endpoint, folder] => Stage::join(endpoint, folder.into()).map(|stage| check(&stage)),
        _ => Err("expected ENDPOINT FOLDER, or router ENDPOINT".into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("ros2-peer: {error}");
            ExitCode::from(2)
        }
    }
}

/// Routes until the program is killed.
fn route(endpoint: &str) -> Result<bool, Error> {
    let _router = stage::router(endpoint)?;
    eprintln!("ready: router at {endpoint}");
    loop {
        std::thread::park();
    }
}

/// Whether all checks hold.
fn check(stage: &Stage) -> bool {
    let mut held = 0;
    for (name, check) in CHECKS {
        match check(stage) {
            Ok(seen) => {
                held += 1;
                println!("holds   {name}: {seen}");
            }
            Err(error) => println!("FAILED  {name}: {error}"),
        }
    }
    println!("ros2-peer: {held} of {} checks hold", CHECKS.len());
    held == CHECKS.len()
}
