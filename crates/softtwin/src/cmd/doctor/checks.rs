//! The checks. Each looks at one thing and never fails: not being able to look is a finding too.

use super::Finding;
use runtime::config::{Scene, Settings};
use runtime::machine;
use runtime::source::live::LiveSource;
use runtime::source::{Source, SourceSpec};
use runtime::twin::load_scene;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::time::Duration;
use wire::{
    Bus, CommandReader, FieldReader, GraspReader, HealthReader, KeyExpr, SensorReader, StateReader,
    TopicKind, WireError,
};

/// What to look at besides the machine.
pub struct Subject<'a> {
    pub scene: Option<&'a Path>,
    pub config: Option<&'a Path>,
}

/// A full field topic takes 58 MB (see `wire::qos`); two of them and the small topics fit into this.
const SHM_WANTED_BYTES: u64 = 128 << 20;
/// How long a sensor may take to answer once, its own time-outs and first attempts to reconnect included.
const SENSOR_PATIENCE: Duration = Duration::from_secs(3);
/// How long the removal of what dead programs left may take.
const CLEAN_UP: Duration = Duration::from_secs(2);

impl Subject<'_> {
    /// All findings, the machine first.
    pub fn examine(&self, bus: Result<Bus, WireError>) -> Vec<Finding> {
        let settings = self.config.map(Settings::load);
        let mut findings = vec![shared_memory(), domain(&bus)];
        if let Ok(bus) = &bus {
            findings.push(management_files(&bus.folder()));
            findings.extend(versions(bus));
        }
        let wished = settings.as_ref().and_then(|settings| settings.as_ref().ok());
        findings.extend(real_time(wished));
        match settings {
            Some(Err(error)) => findings.push(Finding::bad("settings", error.to_string(), "mend the file")),
            Some(Ok(_)) => findings.push(Finding::good("settings", "read, nothing wrong")),
            None => {}
        }
        if let Some(path) = self.scene {
            findings.extend(scene(path));
        }
        findings
    }
}

fn shared_memory() -> Finding {
    let subject = "/dev/shm";
    let room = match machine::room(Path::new(subject)) {
        Ok(room) => room,
        Err(error) => {
            return Finding::bad(subject, error.to_string(), "mount it: mount -t tmpfs tmpfs /dev/shm");
        }
    };
    let found = format!("{} MB free of {} MB", room.free_bytes >> 20, room.total_bytes >> 20);
    if !machine::is_writable(Path::new(subject)) {
        return Finding::bad(subject, "not writable for this user", "chmod 1777 /dev/shm");
    }
    if room.free_bytes < SHM_WANTED_BYTES {
        let remedy = format!(
            "free space, or enlarge it: mount -o remount,size=1G /dev/shm; a full field topic and the small ones want {} MB",
            SHM_WANTED_BYTES >> 20
        );
        return Finding::bad(subject, found, remedy);
    }
    Finding::good(subject, found)
}

/// Joining the domain removes what dead programs left.
fn domain(bus: &Result<Bus, WireError>) -> Finding {
    match bus {
        Err(error) => Finding::bad(
            "domain",
            error.to_string(),
            "run as the user that runs the twin, with its SOFTTWIN_ROOT and SOFTTWIN_DOMAIN",
        ),
        Ok(bus) => match bus.clean_up(CLEAN_UP) {
            0 => Finding::good("domain", "joined, nothing left behind by dead programs"),
            count => Finding::good(
                "domain",
                format!("joined; what dead programs left was removed ({count} nodes)"),
            ),
        },
    }
}

/// Who opens a topic writes to the domain's folder, and waits for its disk.
fn management_files(folder: &Path) -> Finding {
    let subject = "management files";
    match machine::is_in_memory(folder) {
        Err(error) => Finding::warning(subject, format!("{}: {error}", folder.display()), "check its rights"),
        Ok(true) => Finding::good(subject, format!("{}, in memory", folder.display())),
        Ok(false) => Finding::warning(
            subject,
            format!("{}, on a disk: while it is busy, programs start late", folder.display()),
            "SOFTTWIN_ROOT=/run/softtwin for all programs, as in the units, or another folder that lives in memory",
        ),
    }
}

/// Opens every topic as a reader: programs of another version have other types.
fn versions(bus: &Bus) -> Vec<Finding> {
    let everything = KeyExpr::new("softtwin/**");
    let topics = match everything.map(|key| bus.topics(&key)) {
        Ok(Ok(topics)) => topics,
        Ok(Err(error)) => {
            return vec![Finding::bad(
                "topics",
                error.to_string(),
                "check the rights on the domain's folder",
            )];
        }
        Err(error) => {
            return vec![Finding::bad(
                "topics",
                error.to_string(),
                "report this: the key is the program's own",
            )];
        }
    };
    if topics.is_empty() {
        return vec![Finding::warning(
            "topics",
            "none in this domain",
            "start `softtwind twin` and `softtwind bridge`",
        )];
    }
    let mut findings = Vec::new();
    for info in topics {
        let topic = &info.topic;
        let opened: Result<(), WireError> = match topic.kind() {
            TopicKind::Sensor => SensorReader::open(bus, topic).map(drop),
            TopicKind::State => StateReader::open(bus, topic).map(drop),
            TopicKind::Health => HealthReader::open(bus, topic).map(drop),
            TopicKind::Field => FieldReader::open(bus, topic).map(drop),
            TopicKind::Grasp => GraspReader::open(bus, topic).map(drop),
            TopicKind::Command => CommandReader::open(bus, topic).map(drop),
        };
        let writers = info.writers.len();
        findings.push(match opened {
            Err(error) => Finding::bad(
                topic.name(),
                error.to_string(),
                "run the same release everywhere; restart the older one",
            ),
            Ok(()) if writers == 0 => Finding::warning(
                topic.name(),
                "nobody publishes",
                "start its bridge or twin; readers wait for it",
            ),
            Ok(()) => {
                Finding::good(topic.name(), format!("{}, {} readers", info.payload_type, info.readers.len()))
            }
        });
    }
    findings
}

/// Rights for real time: bad only where the settings ask for them.
fn real_time(settings: Option<&Settings>) -> Vec<Finding> {
    let wished = settings.map(|settings| &settings.realtime);
    let remedy =
        |line: &str| format!("systemd: {line} in the unit; by hand: the same in /etc/security/limits.conf");
    let wanted = wished.map_or(0, |wished| u64::from(wished.fifo_priority));
    let priority = machine::fifo_priority_limit();
    let found = priority.map_or("any".into(), |limit| format!("up to {limit}"));
    let priority = match (priority.is_none_or(|limit| limit >= wanted.max(1)), wanted) {
        (true, _) => Finding::good("real-time priority", found),
        (false, 0) => Finding::warning("real-time priority", found, remedy("LimitRTPRIO=60")),
        (false, _) => {
            Finding::bad("real-time priority", format!("{found}, {wanted} wanted"), remedy("LimitRTPRIO=60"))
        }
    };
    let locked = machine::locked_memory_limit();
    let found = locked.map_or("no limit".into(), |limit| format!("{} MB", limit >> 20));
    let locked = match (locked, wished.is_some_and(|wished| wished.lock_memory)) {
        (None, _) => Finding::good("locked memory", found),
        (Some(_), false) => Finding::warning("locked memory", found, remedy("LimitMEMLOCK=infinity")),
        (Some(_), true) => Finding::bad("locked memory", found, remedy("LimitMEMLOCK=infinity")),
    };
    vec![priority, locked]
}

fn scene(path: &Path) -> Vec<Finding> {
    let scene = match Scene::load(path) {
        Ok(scene) => scene,
        Err(error) => return vec![Finding::bad("scene", error.to_string(), "mend the file")],
    };
    let mut findings = vec![match load_scene(&scene, path) {
        Ok(loaded) => {
            let names: Vec<&str> = loaded.iter().map(|loaded| loaded.spec.name.as_str()).collect();
            Finding::good("scene and models", format!("{} loaded", names.join(", ")))
        }
        Err(error) => Finding::bad(
            "scene and models",
            error.to_string(),
            "`softtwin inspect` the model; train it again if it is damaged",
        ),
    }];
    for actuator in &scene.actuators {
        if let Some(spec) = &actuator.source {
            findings.push(source(&format!("source of `{}`", actuator.name), spec, &scene.folder));
        }
    }
    findings
}

fn source(subject: &str, spec: &SourceSpec, folder: &Path) -> Finding {
    match spec.open(folder) {
        Err(problems) => Finding::bad(subject, problems.join("; "), "mend the scene or the trace"),
        Ok(Source::Live(spec)) => sensor(subject, spec),
        Ok(mut source) => match source.next_reading() {
            Some(reading) => Finding::good(subject, format!("first reading {} MPa", reading.pressure_mpa)),
            None => Finding::bad(subject, "it has no readings", "choose another part of the trace"),
        },
    }
}

/// Asks the sensor once.
fn sensor(subject: &str, spec: runtime::source::live::LiveSpec) -> Finding {
    let (sender, receiver) = sync_channel(1);
    let started = match LiveSource::start(spec, 0, sender) {
        Ok(started) => started,
        Err(error) => {
            return Finding::bad(subject, error.to_string(), "the system has no thread left: raise TasksMax");
        }
    };
    match receiver.recv_timeout(SENSOR_PATIENCE) {
        Ok(reading) if reading.status == 0 => {
            let found = format!(
                "it answers: {} MPa, gap {} mm, force {} N",
                reading.pressure_mpa, reading.gap_mm, reading.measured_force_n
            );
            Finding::good(subject, found)
        }
        Ok(reading) => {
            let found = format!("it answers with fault {}", reading.status);
            Finding::bad(
                subject,
                found,
                "Modbus: 2 wrong register, 4 the device itself is faulty; see its manual",
            )
        }
        Err(_) => {
            let counted: Vec<String> = started
                .counters()
                .all()
                .iter()
                .filter(|(_, count)| *count > 0)
                .map(|(name, count)| format!("{count} {name}"))
                .collect();
            let found = format!("no reading within {} s ({})", SENSOR_PATIENCE.as_secs(), counted.join(", "));
            let remedy = "timeouts: wiring, unit_id, baud; refusals: address, port, rights (group dialout), a bridge that holds \
                          the port; garbage: parity, baud, encoding";
            Finding::bad(subject, found, remedy)
        }
    }
}
