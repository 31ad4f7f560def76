//! A shared-memory domain belongs to one user: others are refused, cannot harm it, and cannot take its names beforehand.
//!
//! Programs run as users that exist nowhere but in these tests, which takes root.

use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::Command;
use tests::skip::{Missing, skipped};
use tests::wait::wait_until;
use tests::{Program, Stage};
use wire::{Bus, Domain, State, StateReader, StateWriter, Topic};

const SERVICE: u32 = 61_001;
const STRANGER: u32 = 61_002;
const OWN: u32 = 61_003;
const ALSO_OWN: u32 = 61_004;
const SQUATTED: u32 = 61_005;

const STEADY: &str = "kind = \"simulate\"\nrate_hz = 200.0\ngap_mm = 30.0";
/// Says to this program what to do as another user.
const ROLE: &str = "SOFTTWIN_TEST_ROLE";
/// Process number of the twin, for the role that sends it a signal.
const TWIN: &str = "SOFTTWIN_TEST_TWIN";

/// A stage whose folder belongs to the service's user.
struct ServiceStage(Stage);

impl ServiceStage {
    fn new(label: &str, mode: u32) -> Self {
        let stage = Stage::new(label);
        set_mode(stage.folder.path(), 0o755);
        make_folder(&stage.root(), SERVICE, mode);
        Self(stage)
    }

    /// Files of the domain in /dev/shm; those of strangers as well.
    fn shared(&self) -> Vec<PathBuf> {
        let prefix = self.0.domain().prefix.replace("_u0_", &format!("_u{SERVICE}_"));
        let entries = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(&prefix)).collect()
    }
}

impl std::ops::Deref for ServiceStage {
    type Target = Stage;

    fn deref(&self) -> &Stage {
        &self.0
    }
}

impl Drop for ServiceStage {
    fn drop(&mut self) {
        self.shared().iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

/// With its mode whatever the umask is at this moment: other tests bind listeners in other threads.
fn make_folder(path: &Path, user: u32, mode: u32) {
    std::fs::create_dir(path).unwrap();
    chown(path, Some(user), Some(user)).unwrap();
    set_mode(path, mode);
}

/// A file of another user with a name that programs want.
fn make_file(path: &Path, user: u32) {
    std::fs::write(path, [0; 16]).unwrap();
    chown(path, Some(user), Some(user)).unwrap();
    set_mode(path, 0o666);
}

fn set_mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

fn mode_of(path: &Path) -> u32 {
    std::fs::symlink_metadata(path).unwrap().permissions().mode() & 0o777
}

/// A command line as another user, in the stage's domain or, with `environment`, in another one.
fn as_user(stage: &Stage, user: u32, environment: &str, line: &str) -> Program {
    let own = std::env::current_exe().unwrap();
    let line = line.replace("ROLE", &format!("{} --exact users::in_another_role --nocapture", own.display()));
    let line = format!("{environment} exec setpriv --reuid {user} --regid {user} --clear-groups {line}");
    Program::shell(stage, &line)
}

/// This test program as another user, in a role.
fn in_role(stage: &Stage, user: u32, role: &str) -> Program {
    as_user(stage, user, &format!("export {ROLE}={role};"), "ROLE")
}

/// As [`in_role`], in that user's own domain.
fn in_own_domain(stage: &Stage, user: u32, role: &str) -> Program {
    as_user(stage, user, &format!("unset SOFTTWIN_DOMAIN SOFTTWIN_ROOT; export {ROLE}={role};"), "ROLE")
}

/// Role of this program as another user; without the variable it does nothing.
#[test]
fn in_another_role() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let domain = Domain::from_env();
    let topic = Topic::state("other").unwrap();
    let said = match role.as_str() {
        "open" => Bus::open(&domain).map(|bus| format!("opened {}", bus.folder().display())),
        "publish" => Bus::open(&domain)
            .and_then(|bus| StateWriter::create(&bus, &topic).map(|_| "publishes".to_owned())),
        "publish-on" => Bus::open(&domain).and_then(|bus| {
            let mut writer = StateWriter::create(&bus, &topic)?;
            println!("SAID publishes");
            loop {
                writer.publish(State::default())?;
                std::thread::sleep(std::time::Duration::from_millis(2));
            }
        }),
        "read" => Bus::open(&domain).and_then(|bus| {
            let states = StateReader::open(&bus, &topic)?;
            wait_until("a state", || states.next().unwrap());
            Ok("received".to_owned())
        }),
        "attack" => Ok(attack(&domain)),
        other => panic!("no role {other}"),
    };
    println!("SAID {}", said.unwrap_or_else(|error| format!("refused: {error:?}")));
}

/// Tries everything in the file system that would disturb a shared-memory domain; says how many tries there were and which
/// succeeded.
fn attack(domain: &Domain) -> String {
    let root = PathBuf::from(domain.root.clone().expect("a folder"));
    let (mut tries, mut done) = (0, Vec::new());
    let mut attempt = |what: String, succeeded: bool| {
        tries += 1;
        if succeeded {
            done.push(what);
        }
    };
    // The prefix of this domain has the number of its own user, the attacked one the service's.
    let prefix = domain.prefix.replace(&format!("_u{STRANGER}_"), &format!("_u{SERVICE}_"));
    let mut count = 0;
    for file in std::fs::read_dir("/dev/shm").expect("readable").map(|entry| entry.expect("an entry").path())
    {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if !name.starts_with(&prefix) {
            continue;
        }
        count += 1;
        let open = |write: bool| std::fs::OpenOptions::new().read(!write).write(write).open(&file).is_ok();
        attempt(format!("read {name}"), open(false));
        attempt(format!("write {name}"), open(true));
        attempt(
            format!("permissions of {name}"),
            std::fs::set_permissions(&file, PermissionsExt::from_mode(0o666)).is_ok(),
        );
        attempt(format!("rename {name}"), std::fs::rename(&file, file.with_extension("away")).is_ok());
        attempt(format!("link {name}"), std::fs::hard_link(&file, file.with_extension("link")).is_ok());
        attempt(format!("remove {name}"), std::fs::remove_file(&file).is_ok());
        // Allowed, and without effect: a file of that kind in the stranger's name.
        std::fs::write(file.with_extension("of-a-stranger"), "").expect("/dev/shm is open to all");
    }
    assert!(count > 10, "the attacked domain is empty");
    attempt("list the folder".into(), std::fs::read_dir(&root).is_ok());
    attempt("a file in the folder".into(), std::fs::write(root.join("new"), "").is_ok());
    attempt("the start lock".into(), std::fs::File::open(root.join("softtwin.lock")).is_ok());
    attempt(
        "another folder in its place".into(),
        std::fs::rename(&root, root.with_extension("away")).is_ok(),
    );
    attempt(
        "permissions of the folder".into(),
        std::fs::set_permissions(&root, PermissionsExt::from_mode(0o777)).is_ok(),
    );
    attempt("join".into(), Bus::open(domain).is_ok());
    let twin = std::env::var(TWIN).ok().and_then(|text| text.parse().ok()).expect("a number");
    // SAFETY: signal 0 only asks whether a signal may be sent.
    attempt("signal the twin".into(), unsafe { libc::kill(twin, 0) } == 0);
    format!("{tries} tries, done: {done:?}")
}

/// Whether programs can run here as other users.
fn has_other_users() -> bool {
    // SAFETY: the call has no arguments and cannot fail.
    let is_root = unsafe { libc::geteuid() } == 0;
    is_root && Command::new("setpriv").arg("--version").output().is_ok_and(|output| output.status.success())
}

/// A daemon of the service's user; all its files are readable.
fn daemon(stage: &ServiceStage, role: &str) -> Program {
    let scene = stage.finger(STEADY).display().to_string();
    // Made while other tests may bind listeners, which narrows the umask.
    for file in std::fs::read_dir(stage.folder.path()).unwrap().map(|entry| entry.unwrap().path()) {
        if file.is_file() {
            set_mode(&file, 0o644);
        }
    }
    let mut program = as_user(stage, SERVICE, "", &format!("softtwind {role} --scene {scene}"));
    program.wait_for("ready:");
    program
}

#[test]
fn other_users_and_root_are_refused_and_make_no_file() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = ServiceStage::new("door", 0o700);
    let (twin, bridge) = (daemon(&stage, "twin"), daemon(&stage, "bridge"));
    for path in stage.shared().iter().chain([&stage.root()]) {
        assert_eq!(mode_of(path) & 0o077, 0, "{} is open to others", path.display());
    }
    for user in [STRANGER, 0] {
        for line in ["softtwin echo softtwin/finger/state --once", "softtwin list", "softtwin top --once"] {
            let (status, said) = as_user(&stage, user, "", line).ended();
            let said = said.join(" ");
            assert_eq!(status.code(), Some(78), "{said}");
            assert!(said.contains(&format!("belongs to user {SERVICE}")), "{said}");
            assert!(said.contains(&format!("sudo -u '#{SERVICE}'")), "{said}");
        }
        let of_user = |path: &&PathBuf| std::fs::symlink_metadata(path).is_ok_and(|file| file.uid() == user);
        let files = stage.everything();
        let made: Vec<_> = files.iter().filter(of_user).collect();
        assert!(made.is_empty(), "user {user} made {made:?}");
    }
    for program in [bridge, twin] {
        let (status, said) = program.stop();
        assert!(status.success(), "{said:?}");
    }
}

/// A stranger attacks and leaves files in the domain's names; meanwhile no state is lost, and new programs join.
#[test]
fn strangers_do_no_harm() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = ServiceStage::new("harm", 0o700);
    let (twin, bridge) = (daemon(&stage, "twin"), daemon(&stage, "bridge"));
    let mut states = as_user(&stage, SERVICE, "", "softtwin echo softtwin/finger/state --count 400 --json");
    states.wait_for("\"seq\"");
    let environment = format!("export {ROLE}=attack {TWIN}={};", twin.id());
    let said = as_user(&stage, STRANGER, &environment, "ROLE").wait_for("SAID");
    assert!(said.ends_with("done: []"), "{said}");
    assert!(in_role(&stage, SERVICE, "publish").wait_for("SAID").contains("publishes"));
    let (status, said) = states.ended();
    assert!(status.success());
    let numbers: Vec<u64> = said
        .iter()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok()?["sample"]["seq"].as_u64())
        .collect();
    assert!(numbers.len() >= 300, "{} states", numbers.len());
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "a state was lost");
    assert!(bridge.stop().0.success() && twin.stop().0.success());
}

/// What root makes by hand, or made before the folder was given to a user, does not stop that user's programs.
#[test]
fn leftovers_of_root_do_not_block_a_start() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = ServiceStage::new("left", 0o700);
    for folder in ["nodes", "services", "nodes/123"] {
        make_folder(&stage.root().join(folder), 0, 0o700);
    }
    for file in ["softtwin.lock", "nodes/123/node.details", "services/other.service"] {
        make_file(&stage.root().join(file), 0);
        set_mode(&stage.root().join(file), 0o600);
    }
    assert!(in_role(&stage, SERVICE, "publish").wait_for("SAID").contains("publishes"));
    // In folders of the user itself.
    make_folder(&stage.root().join("nodes/456"), 0, 0o700);
    for file in ["nodes/456/node.details", "services/other.service"] {
        make_file(&stage.root().join(file), 0);
        set_mode(&stage.root().join(file), 0o600);
    }
    assert!(in_role(&stage, SERVICE, "publish").wait_for("SAID").contains("publishes"));
    assert!(
        !stage.root().join("nodes/456").exists() && !stage.root().join("services/other.service").exists()
    );
}

#[test]
fn a_folder_in_which_others_write_is_refused_and_one_that_they_enter_is_found() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    for (mode, is_refused) in [(0o777, true), (0o2770, true), (0o755, false), (0o711, false)] {
        let stage = ServiceStage::new("mode", mode);
        let said = in_role(&stage, SERVICE, "open").wait_for("SAID");
        assert_eq!(said.contains("OpenFolder"), is_refused, "{mode:o}: {said}");
        let (status, said) = as_user(&stage, SERVICE, "", "softtwin doctor").ended();
        let advice = format!("chmod 700 {}", stage.root().display());
        assert!(!status.success() && said.iter().any(|line| line.contains(&advice)), "{mode:o}: {said:?}");
    }
}

#[test]
fn a_folder_that_others_can_replace_is_found() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = ServiceStage::new("above", 0o700);
    let advice = format!("chmod go-w {}", stage.folder.path().display());
    for (mode, is_found) in [(0o777, true), (0o775, true), (0o1777, false), (0o755, false)] {
        set_mode(stage.folder.path(), mode);
        let (_, said) = as_user(&stage, SERVICE, "", "softtwin doctor").ended();
        assert_eq!(said.iter().any(|line| line.contains(&advice)), is_found, "{mode:o}: {said:?}");
    }
}

/// Without a name and a folder the domain is the user's own. A stranger may have taken all its names before; programs of the
/// user find one another all the same, also when the stranger gives the names back.
#[test]
fn users_have_domains_of_their_own_whatever_names_a_stranger_took() {
    if !has_other_users() {
        return skipped(Missing::SecondUser);
    }
    let stage = Stage::new("own");
    set_mode(stage.folder.path(), 0o755);
    let folder = |user: u32| PathBuf::from(format!("/tmp/softtwin-{user}"));
    let shared = |user: u32| {
        let of_user = move |path: &PathBuf| path.to_string_lossy().contains(&format!("/iox2_u{user}"));
        std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path()).filter(of_user)
    };
    let clean = || {
        for user in [OWN, ALSO_OWN, SQUATTED] {
            for folder in [folder(user), PathBuf::from(format!("/tmp/softtwin-{user}-1"))] {
                let _of_a_killed_test = std::fs::remove_dir_all(folder);
            }
            shared(user).for_each(|path| drop(std::fs::remove_file(path)));
        }
    };
    clean();
    for user in [OWN, ALSO_OWN] {
        let said = in_own_domain(&stage, user, "open").wait_for("SAID");
        assert!(said.contains(&format!("opened {}", folder(user).display())), "{said}");
        assert_eq!(mode_of(&folder(user)), 0o700);
        assert_eq!(shared(user).map(|path| mode_of(&path)).collect::<Vec<_>>(), [0o600], "the counter");
    }
    // A damaged counter is made again.
    let counter = shared(OWN).next().unwrap();
    std::fs::write(&counter, [0; 16]).unwrap();
    assert!(in_own_domain(&stage, OWN, "open").wait_for("SAID").contains("opened"));

    // The names that a stranger can know: the folder, the counter, the writers' locks.
    let mut publisher = in_own_domain(&stage, OWN, "publish-on");
    publisher.wait_for("SAID publishes");
    let is_lock = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "writer");
    let lock = shared(OWN).find(is_lock).expect("a writer's lock");
    publisher.kill();
    std::fs::remove_file(&lock).unwrap();
    make_file(&lock, STRANGER);
    let mut publisher = in_own_domain(&stage, OWN, "publish-on");
    publisher.wait_for("SAID publishes");
    std::fs::remove_file(&lock).unwrap();
    let second = in_own_domain(&stage, OWN, "publish").wait_for("SAID");
    assert!(second.contains("refused: AlreadyPublished"), "{second}");
    publisher.kill();

    let squatted = |path: &Path| path.to_string_lossy().replace(&OWN.to_string(), &SQUATTED.to_string());
    let counter = PathBuf::from(squatted(&counter));
    make_file(&counter, STRANGER);
    make_folder(&folder(SQUATTED), STRANGER, 0o777);
    let mut publisher = in_own_domain(&stage, SQUATTED, "publish-on");
    publisher.wait_for("SAID publishes");
    assert!(in_own_domain(&stage, SQUATTED, "read").wait_for("SAID").contains("received"));
    assert_eq!(std::fs::read_dir(folder(SQUATTED)).unwrap().count(), 0);
    std::fs::remove_file(&counter).unwrap();
    std::fs::remove_dir(folder(SQUATTED)).unwrap();
    assert!(in_own_domain(&stage, SQUATTED, "read").wait_for("SAID").contains("received"));
    publisher.kill();
    clean();
}
