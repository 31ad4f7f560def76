//! Shared-memory domain of a group: members read, other users are refused, and a second group may drive valves.
//!
//! Programs run as users that exist nowhere but in these tests, which takes root.

use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use tests::skip::{Missing, skipped};
use tests::{Program, Stage};
use wire::layout::query_kind;
use wire::{
    Bus, Domain, Query, QueryClient, QueryServer, SetpointWriter, StateReader, TargetWriter, Topic, WakeSet,
    Wakeable,
};

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
/// Process number of the twin, for the roles that send it a signal.
const TWIN: &str = "SOFTTWIN_TEST_TWIN";
/// First cells of the table in OPERATIONS.md.
const RIGHTS: [&str; 6] = [
    "subscribe",
    "query",
    "publish readings, states, fields",
    "publish setpoints, overrides, targets, commands",
    "stop or reload a daemon",
    "rename or remove these folders",
];

/// A stage whose domain the group `READERS` shares, where `PUBLISHERS` publish and `DRIVERS` drive valves.
fn shared(label: &str) -> Stage {
    let stage = Stage::new(label);
    set_mode(stage.folder.path(), 0o755);
    for (name, group, mode) in
        [("", READERS, 0o3770), ("control", DRIVERS, 0o2771), ("publish", PUBLISHERS, 0o2771)]
    {
        make_folder(&stage.root().join(name), SERVICE, group, mode);
    }
    stage
}

/// A stage whose domain is private to a user.
fn private(label: &str, user: u32) -> Stage {
    let stage = Stage::new(label);
    set_mode(stage.folder.path(), 0o755);
    make_folder(&stage.root(), user, OTHERS, 0o755);
    stage
}

/// With its mode whatever the umask is at this moment: other tests bind listeners in other threads.
fn make_folder(path: &Path, user: u32, group: u32, mode: u32) {
    std::fs::create_dir(path).unwrap();
    chown(path, Some(user), Some(group)).unwrap();
    set_mode(path, mode);
}

fn set_mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
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
    let domain = Domain::from_env();
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
        "publish-on" => Bus::open(&domain).and_then(|bus| {
            let mut writer = wire::StateWriter::create(&bus, &Topic::state("other")?)?;
            println!("SAID publishes");
            loop {
                writer.publish(wire::State::default())?;
                std::thread::sleep(Duration::from_millis(2));
            }
        }),
        "answer" => Bus::open(&domain).and_then(|bus| {
            let server = QueryServer::create(&bus, "finger")?;
            println!("SAID ready");
            loop {
                while let Some(question) = server.next()? {
                    question.answer(0, |_, _| {})?;
                    println!("SAID answered");
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        }),
        "table" => return RIGHTS.iter().for_each(|right| println!("{}", try_right(&domain, right))),
        "attack" => {
            let (tries, done) = attack(&domain);
            Ok(format!("{tries} tries, done: {done:?}"))
        }
        other => panic!("no role {other}"),
    };
    println!("SAID {}", said.unwrap_or_else(|error| format!("refused: {error}")));
}

/// `SAID RIGHT: yes`, or the text of the refusal.
fn try_right(domain: &Domain, right: &str) -> String {
    let topic = |name: &str| Topic::parse(&format!("softtwin/{name}")).expect("a topic");
    let query = Query { kind: query_kind::WHATIF, pressure_mpa: 0.03, gap_mm: 30.0, ..Query::default() };
    let bus = || Bus::open(domain).map_err(|error| error.to_string());
    let text = |error: wire::WireError| error.to_string();
    let io = |error: std::io::Error| error.to_string();
    let tried = match right {
        "subscribe" => bus().and_then(|bus| {
            let states = StateReader::open(&bus, &topic("finger/state")).map_err(text)?;
            let end = Instant::now() + tests::PATIENCE;
            while states.next().map_err(text)?.is_none() {
                assert!(Instant::now() < end, "no state");
                std::thread::sleep(Duration::from_millis(1));
            }
            Ok(())
        }),
        "query" => bus().and_then(|bus| {
            let mut client = QueryClient::open(&bus, "finger").map_err(text)?;
            client.ask(&query, tests::PATIENCE).map(drop).map_err(text)
        }),
        "publish readings, states, fields" => bus()
            .and_then(|bus| wire::StateWriter::create(&bus, &topic("other/state")).map(drop).map_err(text)),
        "publish setpoints, overrides, targets, commands" => bus().and_then(|bus| {
            // The target first: refused, both have the same text.
            TargetWriter::create_named(&bus, &topic("finger/target"), "test").map_err(text)?;
            SetpointWriter::create_named(&bus, &topic("finger/setpoint"), "test").map(drop).map_err(text)
        }),
        "stop or reload a daemon" => {
            let twin = std::env::var(TWIN).ok().and_then(|text| text.parse().ok()).expect("a number");
            // SAFETY: signal 0 only asks whether a signal may be sent.
            let code = unsafe { libc::kill(twin, 0) };
            if code == 0 { Ok(()) } else { Err(io(std::io::Error::last_os_error())) }
        }
        "rename or remove these folders" => {
            let folder = PathBuf::from(domain.root.clone().expect("a folder"));
            let (here, there) = (folder.join("control"), folder.join("moved"));
            std::fs::rename(&here, &there).and_then(|()| std::fs::rename(&there, &here)).map_err(io)
        }
        other => panic!("no right {other}"),
    };
    format!("SAID {right}: {}", tried.err().unwrap_or_else(|| "yes".into()))
}

/// Tries everything in the file system that would disturb the shared-memory domain; returns the number of tries and what succeeded.
fn attack(domain: &Domain) -> (usize, Vec<String>) {
    let root = PathBuf::from(domain.root.clone().expect("a folder"));
    let shared =
        std::fs::read_dir("/dev/shm").expect("readable").map(|entry| entry.expect("an entry").path());
    let is_ours = |path: &PathBuf| path.to_string_lossy().contains(&format!("/{}", domain.prefix));
    let shared: Vec<PathBuf> = shared.filter(is_ours).collect();
    assert!(shared.len() > 10, "the shared-memory domain is empty");
    let (mut tries, mut done) = (0, Vec::new());
    let mut attempt = |what: String, succeeded: bool| {
        tries += 1;
        if succeeded {
            done.push(what);
        }
    };
    let writable = |path: &Path| std::fs::OpenOptions::new().write(true).open(path).is_ok();
    for file in &shared {
        let name = file.display();
        // Readers write in the members and queues of a service, and count nodes: docs/iceoryx2.md.
        if file.extension().is_some_and(|end| end == "data") {
            attempt(format!("write {name}"), writable(file));
        }
        attempt(
            format!("permissions of {name}"),
            std::fs::set_permissions(file, PermissionsExt::from_mode(0o666)).is_ok(),
        );
        attempt(format!("rename {name}"), std::fs::rename(file, format!("{name}_")).is_ok());
        attempt(format!("remove {name}"), std::fs::remove_file(file).is_ok());
    }
    for folder in ["control", "publish"].map(|name| root.join(name)) {
        let name = folder.display();
        attempt(format!("new file in {name}"), std::fs::write(folder.join("new.writer"), "").is_ok());
        attempt(format!("list {name}"), std::fs::read_dir(&folder).is_ok());
        attempt(format!("rename {name}"), std::fs::rename(&folder, root.join("away")).is_ok());
        attempt(format!("remove {name}"), std::fs::remove_dir_all(&folder).is_ok());
        attempt(
            format!("permissions of {name}"),
            std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o777)).is_ok(),
        );
    }
    let lock = root.join("softtwin.lock");
    attempt("remove the start lock".into(), std::fs::remove_file(&lock).is_ok());
    attempt("rename the start lock".into(), std::fs::rename(&lock, root.join("away")).is_ok());
    attempt(
        "permissions of the root".into(),
        std::fs::set_permissions(&root, PermissionsExt::from_mode(0o777)).is_ok(),
    );
    for right in &RIGHTS[2..] {
        attempt((*right).into(), try_right(domain, right).ends_with(": yes"));
    }
    (tries, done)
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
    let all = [READERS, DRIVERS, PUBLISHERS];
    let (twin, bridge) = (daemon(&stage, "twin", &all), daemon(&stage, "bridge", &all));
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
    make_folder(&control, MEMBER, READERS, 0o755);
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

/// A daemon of the service's user; all its files are readable.
fn daemon(stage: &Stage, role: &str, groups: &[u32]) -> Program {
    let scene = stage.finger(STEADY).display().to_string();
    // Made while other tests may bind listeners, which narrows the umask.
    for file in std::fs::read_dir(stage.folder.path()).unwrap().map(|entry| entry.unwrap().path()) {
        if file.is_file() {
            set_mode(&file, 0o644);
        }
    }
    let line = as_user(SERVICE, groups, &format!("softtwind {role} --scene {scene}"));
    let mut program = Program::shell(stage, &line);
    program.wait_for("ready:");
    program
}

/// The table in OPERATIONS.md: each cell is tried by a user of that kind, and each refusal has the text of the last column.
#[test]
fn each_cell_of_the_table_of_rights_holds() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let document = Path::new(env!("CARGO_MANIFEST_DIR")).join("../OPERATIONS.md");
    let document = std::fs::read_to_string(document).unwrap();
    let rows: Vec<Vec<&str>> = document
        .lines()
        .filter(|line| RIGHTS.iter().any(|right| line.starts_with(&format!("| {right} |"))))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), RIGHTS);
    let stage = shared("table");
    let all = [READERS, DRIVERS, PUBLISHERS];
    let (twin, bridge) = (daemon(&stage, "twin", &all), daemon(&stage, "bridge", &all));
    let users = [
        (1, MEMBER, vec![READERS]),
        (2, MEMBER, vec![READERS, PUBLISHERS]),
        (3, MEMBER, vec![READERS, DRIVERS]),
        (4, SERVICE, vec![READERS]),
        (4, 0, vec![0]),
        (5, STRANGER, vec![OTHERS]),
    ];
    for (column, user, groups) in users {
        let own = std::env::current_exe().unwrap();
        let line = format!("{} --exact sharing::in_another_role --nocapture", own.display());
        let line = format!("export {ROLE}=table {TWIN}={}; {}", twin.id(), as_user(user, &groups, &line));
        let (_, said) = Program::shell(&stage, &line).ended();
        for row in &rows {
            let begin = format!("SAID {}: ", row[0]);
            let found =
                said.iter().find_map(|line| line.split_once(&begin)).unwrap_or_else(|| panic!("{said:?}")).1;
            match row[column] {
                "yes" => assert_eq!(found, "yes", "{}, user {user}", row[0]),
                "no" => {
                    let mut messages = row[7].split('`').skip(1).step_by(2);
                    assert!(
                        messages.any(|message| found.contains(message)),
                        "{}, user {user}: {found}",
                        row[0]
                    );
                }
                cell => panic!("expected yes or no: {cell}"),
            }
        }
    }
    assert!(bridge.stop().0.success() && twin.stop().0.success());
}

/// A reader and a stranger try to harm the shared-memory domain; meanwhile no state is lost.
#[test]
fn readers_and_strangers_do_no_harm() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = shared("harm");
    let all = [READERS, DRIVERS, PUBLISHERS];
    let (twin, bridge) = (daemon(&stage, "twin", &all), daemon(&stage, "bridge", &all));
    let bus = stage.bus();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let rounds: usize = std::env::var("SOFTTWIN_HOSTILE").map_or(1, |count| count.parse().expect("a number"));
    let mut total = 0;
    for _ in 0..rounds {
        for (user, group) in [(MEMBER, READERS), (STRANGER, OTHERS)] {
            let own = std::env::current_exe().unwrap();
            let line = format!("{} --exact sharing::in_another_role --nocapture", own.display());
            let line =
                format!("export {ROLE}=attack {TWIN}={}; {}", twin.id(), as_user(user, &[group], &line));
            let said = Program::shell(&stage, &line).wait_for("SAID");
            assert!(said.ends_with("done: []"), "user {user}: {said}");
            let tries: usize = said.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a number");
            total += tries;
        }
    }
    let (mut last, mut count) = (None, 0);
    while let Some(state) = states.next().unwrap() {
        assert!(last.is_none_or(|last| state.seq == last + 1), "a state was lost after {last:?}");
        (last, count) = (Some(state.seq), count + 1);
    }
    assert!(count > 10, "{count} states");
    println!("{total} tries by a reader and a stranger, none succeeded");
    assert!(bridge.stop().0.success() && twin.stop().0.success());
}

/// A publisher without the right: the folder `publish` was open to it for a moment, and its lock is gone.
#[test]
fn readers_ignore_publishers_without_the_right() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = shared("origin");
    let publish = stage.root().join("publish");
    let open = |mode| std::fs::set_permissions(&publish, std::fs::Permissions::from_mode(mode)).unwrap();
    open(0o2777);
    let mut stranger = in_role(&stage, MEMBER, &[READERS], "publish-on");
    stranger.wait_for("SAID publishes");
    let (bus, topic) = (stage.bus(), Topic::state("other").unwrap());
    let before = StateReader::open(&bus, &topic).unwrap();
    let receives = |what: &str, count: u32| {
        for _ in 0..count {
            tests::wait::wait_until(what, || before.next().unwrap());
        }
    };
    receives("a state of the lock's owner", 1);
    for lock in std::fs::read_dir(&publish).unwrap() {
        std::fs::remove_file(lock.unwrap().path()).unwrap();
    }
    open(0o2771);
    let after = StateReader::open(&bus, &topic).unwrap();
    for _ in 0..20 {
        receives("the stream", 1);
        assert!(after.next().unwrap().is_none(), "a state of a publisher without the right");
    }
    stranger.kill();
}

/// A reader that answers queries, which takes no lock, in place of the twin.
#[test]
fn clients_ignore_answers_of_users_who_may_not_publish() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = shared("answer");
    let query = Query { kind: query_kind::WHATIF, pressure_mpa: 0.03, gap_mm: 30.0, ..Query::default() };
    for (user, groups, is_taken) in [(SERVICE, vec![READERS], true), (MEMBER, vec![READERS], false)] {
        let mut server = in_role(&stage, user, &groups, "answer");
        server.wait_for("SAID ready");
        let bus = stage.bus();
        let mut client = QueryClient::open(&bus, "finger").unwrap();
        let limit = if is_taken { tests::PATIENCE } else { Duration::from_millis(500) };
        assert_eq!(client.ask(&query, limit).is_ok(), is_taken, "user {user}");
        server.wait_for("SAID answered");
        server.kill();
    }
}

/// Root in a user's private domain: refused before it makes a file that the twin would wait for.
#[test]
fn another_user_is_refused_at_the_door_of_a_private_domain() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = private("door", SERVICE);
    let (twin, bridge) = (daemon(&stage, "twin", &[OTHERS]), daemon(&stage, "bridge", &[OTHERS]));
    let files = stage.everything();
    for line in ["softtwin echo softtwin/finger/state --once", "softtwin list", "softtwin top --once"] {
        let (status, said) = Program::shell(&stage, &format!("exec {line}")).ended();
        assert!(
            !status.success() && said.join(" ").contains(&format!("private to user {SERVICE}")),
            "{said:?}"
        );
    }
    let of_root = |path: &&PathBuf| std::fs::metadata(path).is_ok_and(|file| file.uid() == 0);
    let new: Vec<PathBuf> = stage.everything().difference(&files).filter(of_root).cloned().collect();
    assert!(new.is_empty(), "root made files: {new:?}");
    for program in [bridge, twin] {
        let (status, said) = program.stop();
        assert!(status.success(), "{said:?}");
    }
}

/// The counter of nodes, which iceoryx2 makes open to all users: for its users only, made again when damaged, and named
/// when another user has taken its name.
#[test]
fn counter_of_nodes_belongs_to_the_domain() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = shared("counter");
    let counter = |stage: &Stage| {
        let is_counter = |path: &PathBuf| path.to_string_lossy().ends_with(".global_mgmt");
        stage.everything().into_iter().find(is_counter).expect("a counter")
    };
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert!(in_role(&stage, SERVICE, &[READERS], "open").wait_for("SAID").contains("opened"));
    assert!(in_role(&stage, MEMBER, &[READERS], "open").wait_for("SAID").contains("opened"));
    assert_eq!(mode(&counter(&stage)), 0o660);

    let stage = private("counter", OWN);
    let open = || in_role(&stage, OWN, &[OTHERS], "open").wait_for("SAID");
    assert!(open().contains("opened"));
    let path = counter(&stage);
    assert_eq!(mode(&path), 0o600);
    assert!(path.to_string_lossy().contains(&format!("_u{OWN}_")), "{path:?}");
    std::fs::write(&path, [0; 16]).unwrap();
    assert!(open().contains("opened"), "a damaged counter is made again");
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, [0; 16]).unwrap();
    set_mode(&path, 0o666);
    chown(&path, Some(STRANGER), Some(OTHERS)).unwrap();
    let said = open();
    assert!(
        said.contains(&path.display().to_string()) && said.contains(&format!("user {STRANGER}")),
        "{said}"
    );
}

/// A stranger's file with the name of a writer's lock, which /dev/shm lets everyone make: root's programs remove it, those of another
/// user name it, with its owner.
#[test]
fn strangers_writer_lock_is_removed_by_root_and_named_to_others() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    for user in [0, SERVICE] {
        let stage = private("lock", user);
        let mut publisher = in_role(&stage, user, &[OTHERS], "publish-on");
        publisher.wait_for("SAID publishes");
        let is_lock = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "writer");
        let lock = stage.everything().into_iter().find(is_lock).expect("a writer's lock");
        publisher.kill();
        for mode in [0o600, 0o666] {
            let _gone_after_a_refusal_of_root = std::fs::remove_file(&lock);
            std::fs::write(&lock, "1 stranger").unwrap();
            set_mode(&lock, mode);
            chown(&lock, Some(STRANGER), Some(OTHERS)).unwrap();
            let said = in_role(&stage, user, &[OTHERS], "publish").wait_for("SAID");
            let names =
                said.contains(&lock.display().to_string()) && said.contains(&format!("user {STRANGER}"));
            assert!(
                if user == 0 { said.contains("publishes") } else { names },
                "user {user}, mode {mode:o}: {said}"
            );
        }
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
    let folder = |user: u32| PathBuf::from(format!("/tmp/softtwin-{user}"));
    let open = |user: u32| {
        let line = as_user(
            user,
            &[OTHERS],
            &format!("{} --exact sharing::in_another_role --nocapture", own.display()),
        );
        Program::shell(&stage, &format!("unset SOFTTWIN_DOMAIN SOFTTWIN_ROOT; export {ROLE}=open; {line}"))
            .wait_for("SAID")
    };
    // Of a test that was killed.
    for user in [OWN, ALSO_OWN, SQUATTED] {
        let _ = std::fs::remove_dir_all(folder(user));
    }
    for user in [OWN, ALSO_OWN] {
        assert!(open(user).contains("opened"), "user {user}");
        assert_eq!(std::fs::metadata(folder(user)).unwrap().permissions().mode() & 0o777, 0o700);
    }
    std::fs::create_dir(folder(SQUATTED)).unwrap();
    chown(folder(SQUATTED), Some(OWN), None).unwrap();
    assert!(open(SQUATTED).contains(&OWN.to_string()), "the folder's owner is named");
    for user in [OWN, ALSO_OWN, SQUATTED] {
        std::fs::remove_dir_all(folder(user)).unwrap();
        Domain { root: None, prefix: format!("iox2_u{user}_") }.remove_leftovers().unwrap();
    }
}
