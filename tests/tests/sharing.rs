//! Shared-memory domain of a group: members read, other users are refused, and a second group may drive valves.
//!
//! Programs run as users that exist nowhere but in these tests, which takes root.

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tests::skip::{Missing, skipped};
use tests::{Program, Stage};
use wire::{Bus, SetpointWriter, StateReader, Topic, WakeSet, Wakeable};

const SERVICE: u32 = 61_001;
const MEMBER: u32 = 61_002;
const STRANGER: u32 = 61_003;
const OWN: u32 = 61_004;
const ALSO_OWN: u32 = 61_005;
const SQUATTED: u32 = 61_006;
const READERS: u32 = 62_001;
const DRIVERS: u32 = 62_002;
const OTHERS: u32 = 62_003;
const PUBLISHERS: u32 = 62_004;

const STEADY: &str = "kind = \"simulate\"\nrate_hz = 200.0\ngap_mm = 30.0";
/// Says to this program what to do as another user.
const ROLE: &str = "SOFTTWIN_TEST_ROLE";

/// A stage whose domain the group `READERS` shares, where `PUBLISHERS` publish and `DRIVERS` drive valves.
fn shared(label: &str) -> Stage {
    let stage = Stage::new(label);
    let open =
        |path: &Path, mode| std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    open(stage.folder.path(), 0o755);
    for (name, group, mode) in
        [("", READERS, 0o3770), ("control", DRIVERS, 0o2770), ("publish", PUBLISHERS, 0o2770)]
    {
        let folder = stage.root().join(name);
        std::fs::create_dir(&folder).unwrap();
        chown(&folder, Some(SERVICE), Some(group)).unwrap();
        open(&folder, mode);
    }
    stage
}

fn as_user(user: u32, groups: &[u32], line: &str) -> String {
    let all: Vec<String> = groups.iter().map(u32::to_string).collect();
    format!("exec setpriv --reuid {user} --regid {} --groups {} {line}", all[0], all.join(","))
}

/// This test program as another user, in a role.
fn in_role(stage: &Stage, user: u32, groups: &[u32], role: &str) -> Program {
    let own = std::env::current_exe().unwrap();
    let line =
        as_user(user, groups, &format!("{} --exact sharing::in_another_role --nocapture", own.display()));
    Program::shell(stage, &format!("export {ROLE}={role}; {line}"))
}

/// Role of this program as another user; without the variable it does nothing.
#[test]
fn in_another_role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let domain = wire::Domain::from_env();
    let said = match role.as_str() {
        "read" => Bus::open(&domain).and_then(|bus| {
            let states = StateReader::open(&bus, &Topic::state("finger")?)?;
            let (mut wake, end) =
                (WakeSet::new([&states as &dyn Wakeable]), Instant::now() + tests::PATIENCE);
            let (mut first, mut count) = (None, 0u64);
            while count < 200 && Instant::now() < end {
                wake.wait(Duration::from_millis(100))?;
                while let Some(state) = states.next()? {
                    first.get_or_insert(state.seq);
                    count += 1;
                    assert_eq!(state.seq, first.unwrap_or_default() + count - 1, "a state was lost");
                }
            }
            Ok(format!("{count} states"))
        }),
        "drive" => Bus::open(&domain).and_then(|bus| {
            SetpointWriter::create_named(
                &bus,
                &Topic::parse("softtwin/finger/setpoint").expect("a topic"),
                "test",
            )
            .map(|_| "drives".to_owned())
        }),
        "open" => Bus::open(&domain).map(|_| "opened".to_owned()),
        "publish" => Bus::open(&domain).and_then(|bus| {
            wire::StateWriter::create(&bus, &Topic::state("other")?).map(|_| "publishes".to_owned())
        }),
        other => panic!("no role {other}"),
    };
    println!("SAID {}", said.unwrap_or_else(|error| format!("refused: {error}")));
}

/// Whether programs can run here as other users.
fn has_other_users() -> bool {
    // SAFETY: the call has no arguments and cannot fail.
    let is_root = unsafe { libc::geteuid() } == 0;
    is_root && Command::new("setpriv").arg("--version").output().is_ok_and(|output| output.status.success())
}

#[test]
fn group_members_read_and_only_drivers_drive() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = shared("share");
    let scene = stage.finger(STEADY).display().to_string();
    // Opening a shared-memory domain narrows this process's umask for a moment; other tests do so in other threads.
    for file in std::fs::read_dir(stage.folder.path()).unwrap().map(|entry| entry.unwrap().path()) {
        if file.is_file() {
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o644)).unwrap();
        }
    }
    let start = |role: &str| {
        let line =
            as_user(SERVICE, &[READERS, DRIVERS, PUBLISHERS], &format!("softtwind {role} --scene {scene}"));
        let mut program = Program::shell(&stage, &line);
        program.wait_for("ready:");
        program
    };
    let (twin, bridge) = (start("twin"), start("bridge"));
    for _ in 0..3 {
        let line = in_role(&stage, MEMBER, &[READERS], "read").wait_for("SAID");
        assert!(line.contains(" states") && !line.contains(" 0 states"), "{line}");
    }
    let line = in_role(&stage, STRANGER, &[OTHERS], "read").wait_for("SAID");
    assert!(line.contains("refused") && line.contains("Permission denied"), "{line}");

    let line = in_role(&stage, MEMBER, &[READERS], "drive").wait_for("SAID");
    assert!(line.contains("refused") && line.contains("Permission denied"), "{line}");
    let line = in_role(&stage, MEMBER, &[READERS, DRIVERS], "drive").wait_for("SAID");
    assert!(line.contains("drives"), "{line}");

    let line = in_role(&stage, MEMBER, &[READERS, DRIVERS], "publish").wait_for("SAID");
    assert!(line.contains("refused") && line.contains("Permission denied"), "{line}");
    let line = in_role(&stage, MEMBER, &[READERS, PUBLISHERS], "publish").wait_for("SAID");
    assert!(line.contains("publishes"), "{line}");

    // A reader cannot move the folder of the drivers away, and a folder of a reader's in its place gives no right.
    let control = stage.root().join("control");
    let moved = as_user(MEMBER, &[READERS], &format!("mv {} {}-moved", control.display(), control.display()));
    assert!(!Command::new("sh").args(["-c", &moved]).output().unwrap().status.success());
    std::fs::rename(&control, stage.root().join("moved")).unwrap();
    let line = in_role(&stage, MEMBER, &[READERS], "drive").wait_for("SAID");
    assert!(line.contains("refused"), "{line}");
    std::fs::create_dir(&control).unwrap();
    chown(&control, Some(MEMBER), Some(READERS)).unwrap();
    let line = in_role(&stage, MEMBER, &[READERS], "drive").wait_for("SAID");
    assert!(line.contains("refused") && line.contains(&format!("user {MEMBER}")), "{line}");

    // A missing folder is made for the owner of its parent alone.
    std::fs::remove_dir(&control).unwrap();
    let line = in_role(&stage, SERVICE, &[READERS], "drive").wait_for("SAID");
    assert!(line.contains("drives"), "{line}");
    let line = in_role(&stage, MEMBER, &[READERS], "drive").wait_for("SAID");
    assert!(line.contains("refused") && line.contains("Permission denied"), "{line}");
    assert_eq!(std::fs::metadata(&control).unwrap().permissions().mode() & 0o77, 0);

    // The service itself did not notice.
    for program in [bridge, twin] {
        let (status, said) = program.stop();
        assert!(status.success(), "{said:?}");
        assert!(!said.iter().any(|line| line.contains("refused") || line.contains("failed")), "{said:?}");
    }
}

/// Without a name and a folder the shared-memory domain is private to a user; an existing folder of another user is refused.
#[test]
fn users_have_domains_of_their_own() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = Stage::new("own");
    let own = std::env::current_exe().unwrap();
    let folder = |user: u32| std::path::PathBuf::from(format!("/tmp/softtwin-{user}"));
    let open = |user: u32| {
        let line = as_user(
            user,
            &[OTHERS],
            &format!("{} --exact sharing::in_another_role --nocapture", own.display()),
        );
        Program::shell(&stage, &format!("unset SOFTTWIN_DOMAIN SOFTTWIN_ROOT; export {ROLE}=open; {line}"))
            .wait_for("SAID")
    };
    for user in [OWN, ALSO_OWN] {
        assert!(open(user).contains("opened"), "user {user}");
        assert_eq!(std::fs::metadata(folder(user)).unwrap().permissions().mode() & 0o777, 0o700);
    }
    std::fs::create_dir(folder(SQUATTED)).unwrap();
    chown(folder(SQUATTED), Some(OWN), None).unwrap();
    assert!(open(SQUATTED).contains(&OWN.to_string()), "the folder's owner is named");
    for user in [OWN, ALSO_OWN, SQUATTED] {
        std::fs::remove_dir_all(folder(user)).unwrap();
    }
}
