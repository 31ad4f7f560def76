//! Processes under control: started in a stage, their lines read, signalled, killed.

use crate::{PATIENCE, Stage};
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Instant;

/// Lines of a program that a failed test prints.
const LAST_LINES: usize = 40;

/// A running program; killed when dropped.
#[derive(Debug)]
pub struct Program {
    child: Child,
    lines: Receiver<String>,
    /// Lines printed so far, for failure messages.
    pub said: Vec<String>,
}

/// Path of one of our programs, in the folder of the test program.
pub fn binary(name: &str) -> PathBuf {
    let own = std::env::current_exe().expect("a program has a path");
    let folder = own.parent().expect("target/<profile>, or deps in it");
    let folder = if folder.ends_with("deps") { folder.parent().expect("target/<profile>") } else { folder };
    let path = folder.join(name);
    assert!(
        path.exists(),
        "{} is not built; run `cargo build --bins` first (scripts/test.sh does)",
        path.display()
    );
    path
}

impl Program {
    /// Starts `softtwind` in the stage's domain.
    pub fn daemon(stage: &Stage, arguments: &[&str]) -> Self {
        Self::daemon_with(stage, arguments, &[])
    }

    /// As [`Self::daemon`], with additional environment variables.
    pub fn daemon_with(stage: &Stage, arguments: &[&str], environment: &[(&str, String)]) -> Self {
        let mut command = Command::new(binary("softtwind"));
        command.args(arguments).env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC");
        Self::start(stage, command.envs(environment.iter().map(|(key, value)| (key, value))))
    }

    /// As [`Self::traced`], with additional environment variables.
    pub fn traced_with(stage: &Stage, tracing: &[&str], program: &[&str], more: &[(&str, String)]) -> Self {
        Self::start(stage, Self::tracer(tracing, program).envs(more.iter().map(|(key, value)| (key, value))))
    }

    /// Starts `softtwin` in the stage's domain.
    pub fn tool(stage: &Stage, arguments: &[&str]) -> Self {
        Self::start(stage, Command::new(binary("softtwin")).args(arguments))
    }

    /// Starts one of our programs under `strace`, which kills it at a system call or logs its calls.
    ///
    /// # Panics
    /// If `strace` is not installed.
    pub fn traced(stage: &Stage, tracing: &[&str], program: &[&str]) -> Self {
        Self::start(stage, &mut Self::tracer(tracing, program))
    }

    fn tracer(tracing: &[&str], program: &[&str]) -> Command {
        let (name, arguments) = program.split_first().expect("a program");
        // `-D`: our child is the program itself, the tracer is its grandchild.
        let mut command = Command::new("strace");
        command.args(["-D", "-f", "-qq"]).args(tracing).arg(binary(name)).args(arguments);
        assert!(
            Command::new("strace").arg("-V").output().is_ok_and(|output| output.status.success()),
            "strace is not installed: apt-get install strace (.ci/run does)"
        );
        command.env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC");
        command
    }

    /// Starts one of our programs by its name.
    pub fn named(stage: &Stage, program: &[&str]) -> Self {
        let (name, arguments) = program.split_first().expect("a program");
        let mut command = Command::new(binary(name));
        Self::start(stage, command.args(arguments).env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC"))
    }

    /// Runs a shell line in which our programs are found by name.
    pub fn shell(stage: &Stage, line: &str) -> Self {
        let programs = binary("softtwin").parent().expect("a folder").display().to_string();
        let path = format!("{programs}:{programs}/examples:{}", std::env::var("PATH").unwrap_or_default());
        Self::start(stage, Command::new("sh").args(["-c", line]).env("PATH", path))
    }

    /// Starts the twin of a scene and waits until it is ready.
    pub fn twin(stage: &Stage, scene: &std::path::Path) -> Self {
        let mut twin = Self::daemon(stage, &["twin", "--scene", &scene.display().to_string()]);
        twin.wait_for("ready:");
        twin
    }

    /// Starts the bridge of a scene and waits until it is ready.
    pub fn bridge(stage: &Stage, scene: &std::path::Path) -> Self {
        let mut bridge = Self::daemon(stage, &["bridge", "--scene", &scene.display().to_string()]);
        bridge.wait_for("ready:");
        bridge
    }

    /// With umask 022: iceoryx2 narrows that of this process for a moment, in other threads, while a listener is bound.
    fn start(stage: &Stage, command: &mut Command) -> Self {
        // SAFETY: umask is a system call alone, allowed between fork and exec.
        unsafe {
            command.pre_exec(|| {
                libc::umask(0o022);
                Ok(())
            });
        }
        let mut child = command
            .current_dir(stage.folder.path())
            .env("SOFTTWIN_DOMAIN", &stage.domain_name)
            .env("SOFTTWIN_ROOT", stage.root())
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let (sender, lines) = channel();
        let outputs: [Option<Box<dyn Read + Send>>; 2] = [
            child.stdout.take().map(|pipe| Box::new(pipe) as Box<dyn Read + Send>),
            child.stderr.take().map(|pipe| Box::new(pipe) as Box<dyn Read + Send>),
        ];
        for output in outputs.into_iter().flatten() {
            let sender = sender.clone();
            std::thread::spawn(move || {
                BufReader::new(output).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
            });
        }
        Self { child, lines, said: Vec::new() }
    }

    /// Waits for a line that contains `text` and returns it.
    ///
    /// # Panics
    /// If the program ends or [`PATIENCE`] is over before; the message contains all its lines.
    pub fn wait_for(&mut self, text: &str) -> String {
        let end = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    self.said.push(line.clone());
                    if line.contains(text) {
                        return line;
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    panic!("`{text}` did not come; it said:\n{}", self.said.join("\n"))
                }
                Err(RecvTimeoutError::Disconnected) => {
                    panic!("it ended without `{text}`; it said:\n{}", self.said.join("\n"))
                }
            }
        }
    }

    /// Lets the program run until a line contains `text` and for `longer` after it, then tells it to end. It may end, or be
    /// killed, before. Returns its exit code (none: killed) and whether the line came.
    ///
    /// # Panics
    /// When it has not ended after [`PATIENCE`].
    pub fn run_and_stop(
        mut self,
        text: &str,
        longer: std::time::Duration,
    ) -> (Option<i32>, bool, Vec<String>) {
        let mut ready = false;
        let mut end = Instant::now() + PATIENCE;
        while let Ok(line) = self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
            if !ready && line.contains(text) {
                ready = true;
                end = Instant::now() + longer;
            }
            self.said.push(line);
        }
        // SAFETY: the process is our own child and not yet waited for, so its number is not reused.
        let _ended_already_is_fine = unsafe { libc::kill(self.child.id() as i32, libc::SIGTERM) };
        let (status, said) = self.end();
        (status.code(), ready, said)
    }

    /// Sends a signal.
    pub fn signal(&self, signal: i32) {
        // SAFETY: the process is our own child and not yet waited for, so its number is not reused.
        assert_eq!(unsafe { libc::kill(self.child.id() as i32, signal) }, 0, "the program is gone already");
    }

    /// Sends SIGTERM and waits for the end.
    pub fn stop(mut self) -> (ExitStatus, Vec<String>) {
        self.signal(libc::SIGTERM);
        self.end()
    }

    /// Sends SIGKILL and waits for the end.
    pub fn kill(mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("gone");
    }

    /// Waits for the end; returns the exit status and all lines.
    ///
    /// # Panics
    /// If it does not end within [`PATIENCE`].
    pub fn end(&mut self) -> (ExitStatus, Vec<String>) {
        let end = Instant::now() + PATIENCE;
        // Both pipes close when the program ends.
        loop {
            match self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) => self.said.push(line),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {
                    panic!("it does not end; it printed:\n{}", self.said.join("\n"))
                }
            }
        }
        (self.child.wait().expect("ended"), self.said.clone())
    }

    /// As [`Self::end`], for a program that ends by itself.
    pub fn ended(mut self) -> (ExitStatus, Vec<String>) {
        self.end()
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for Program {
    /// When a test fails, what its programs said and whether they still run is half of the answer.
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.said.extend(self.lines.try_iter());
            let state = self.child.try_wait();
            let skipped = self.said.len().saturating_sub(LAST_LINES);
            println!("process {}, ended: {state:?}; after {skipped} lines it said:", self.child.id());
            self.said[skipped..].iter().for_each(|line| println!("{:.300}", line));
        }
        // Ended already is fine.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
