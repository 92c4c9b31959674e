//! Browser driver that uses Chrome's DevTools protocol over two pipes.

use std::any::Any;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Timeout for browser operations, longer than any of them takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(90);

/// Keys that tests press: name, code, number and text of each.
const KEYS: [(&str, &str, u32, &str); 12] = [
    ("Enter", "Enter", 13, "\r"),
    (" ", "Space", 32, " "),
    ("Tab", "Tab", 9, ""),
    ("Escape", "Escape", 27, ""),
    ("ArrowLeft", "ArrowLeft", 37, ""),
    ("ArrowRight", "ArrowRight", 39, ""),
    ("ArrowUp", "ArrowUp", 38, ""),
    ("ArrowDown", "ArrowDown", 40, ""),
    ("Home", "Home", 36, ""),
    ("End", "End", 35, ""),
    ("+", "NumpadAdd", 107, "+"),
    ("0", "Digit0", 48, "0"),
];

/// Lock that keeps other browsers closed while a test measures durations: the browser of such a test holds it for
/// writing, every other browser for reading.
static OPEN: RwLock<()> = RwLock::new(());

/// Browser with one open page.
pub struct Browser {
    process: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    session: Option<String>,
    last_id: u64,
    /// Events received while waiting for a result.
    events: Vec<Value>,
    _profile: TempDir,
    /// Guard of [`OPEN`], released when the browser has ended.
    _open: Box<dyn Any>,
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The other processes of the browser end when the first one is killed.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn place() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("TRILINK_BROWSER") {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    let mut places = std::env::split_paths(&path).flat_map(|folder| NAMES.map(|n| folder.join(n)));
    places.find(|place| place.is_file())
}

impl Browser {
    /// Starts the browser that the environment variable `TRILINK_BROWSER` names, or the first one in `PATH`. If there
    /// is no browser, prints a message and returns `None`; the test then passes.
    pub fn start() -> Option<Self> {
        Self::locked(|| Box::new(OPEN.read().unwrap_or_else(PoisonError::into_inner)))
    }

    /// Starts a browser like [`Browser::start`], but only while no other test has one open; for tests of durations.
    pub fn start_alone() -> Option<Self> {
        Self::locked(|| Box::new(OPEN.write().unwrap_or_else(PoisonError::into_inner)))
    }

    fn locked(lock: impl FnOnce() -> Box<dyn Any>) -> Option<Self> {
        let Some(place) = place() else {
            eprintln!("skipped: no browser among {NAMES:?}; TRILINK_BROWSER can name one");
            return None;
        };
        let open = lock();
        let profile = tempfile::tempdir().expect("a temporary folder");
        // The browser reads commands from descriptor 3 and answers to descriptor 4.
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1"])
            .arg(place)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"])
            .args(["--no-first-run", "--disable-background-networking", "--disable-sync"])
            .args(["--disable-component-update", "--remote-debugging-pipe"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the browser starts");
        let to = process.stdin.take().expect("a pipe");
        let answers = BufReader::new(process.stdout.take().expect("a pipe"));
        let (sender, from) = channel();
        std::thread::spawn(move || {
            for message in answers.split(0).map_while(Result::ok) {
                let message = serde_json::from_slice(&message).expect("a message is JSON");
                if sender.send(message).is_err() {
                    break;
                }
            }
        });
        let mut browser = Self {
            process,
            to,
            from,
            session: None,
            last_id: 0,
            events: Vec::new(),
            _profile: profile,
            _open: open,
        };
        let page = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let target = json!({ "targetId": page["targetId"], "flatten": true });
        let attached = browser.call("Target.attachToTarget", target);
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Network", "Log"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        Some(browser)
    }

    fn send(&mut self, method: &str, params: Value) -> u64 {
        self.last_id += 1;
        let mut message = json!({ "id": self.last_id, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).expect("the browser listens");
        self.last_id
    }

    /// Returns the next message from the browser; dialogs are closed, so that the page continues.
    fn message(&mut self) -> Value {
        let message = self.from.recv_timeout(PATIENCE).expect("the browser answers");
        if message["method"] == "Page.javascriptDialogOpening" {
            self.send("Page.handleJavaScriptDialog", json!({ "accept": false }));
        }
        message
    }

    /// Sends a command of the DevTools protocol and returns its result.
    #[track_caller]
    pub fn call(&mut self, method: &str, params: Value) -> Value {
        let id = self.send(method, params);
        loop {
            let mut message = self.message();
            if message["id"] == id {
                assert!(message["error"].is_null(), "{method}: {}", message["error"]);
                return message["result"].take();
            }
            self.events.push(message);
        }
    }

    /// Waits for a DevTools event.
    pub fn wait_for(&mut self, method: &str) {
        loop {
            let message = self.message();
            let found = message["method"] == method;
            self.events.push(message);
            if found {
                return;
            }
        }
    }

    /// Opens a page and waits until it is loaded.
    pub fn open(&mut self, page: &Path) {
        // A link to another part of the current page would not reload the page.
        self.send("Page.navigate", json!({ "url": "about:blank" }));
        self.wait_for("Page.loadEventFired");
        self.send("Page.navigate", json!({ "url": format!("file://{}", page.display()) }));
        self.wait_for("Page.loadEventFired");
    }

    /// Evaluates a JavaScript expression in the page and returns its value; promises are awaited.
    #[track_caller]
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let params =
            json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut result = self.call("Runtime.evaluate", params);
        let thrown = &result["exceptionDetails"];
        assert!(thrown.is_null(), "{expression}: {thrown}");
        result["result"]["value"].take()
    }

    pub fn window(&mut self, width: u32, height: u32) {
        let size =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Emulates a user preference for a dark or a light colour scheme.
    pub fn dark(&mut self, is_dark: bool) {
        let scheme = if is_dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Enables or disables scripts on pages that are opened later.
    pub fn scripts(&mut self, run: bool) {
        self.call("Emulation.setScriptExecutionDisabled", json!({ "value": !run }));
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let button = if kind == "mouseMoved" { "none" } else { "left" };
        let event = json!({ "type": kind, "x": x, "y": y, "button": button, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Moves the pointer to a position in the window.
    pub fn point(&mut self, at: [f64; 2]) {
        self.mouse("mouseMoved", at);
    }

    pub fn click(&mut self, at: [f64; 2]) {
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            self.mouse(kind, at);
        }
    }

    pub fn double_click(&mut self, [x, y]: [f64; 2]) {
        for count in [1, 2] {
            for kind in ["mousePressed", "mouseReleased"] {
                let event =
                    json!({ "type": kind, "x": x, "y": y, "button": "left", "clickCount": count });
                self.call("Input.dispatchMouseEvent", event);
            }
        }
    }

    /// Moves the pointer from one position in the window to another with the button held down.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.point(from);
        self.mouse("mousePressed", from);
        let middle = [0, 1].map(|i| 0.5 * (from[i] + to[i]));
        for [x, y] in [middle, to] {
            let event =
                json!({ "type": "mouseMoved", "x": x, "y": y, "button": "left", "buttons": 1 });
            self.call("Input.dispatchMouseEvent", event);
        }
        self.mouse("mouseReleased", to);
    }

    /// Taps on a position in the window.
    pub fn tap(&mut self, [x, y]: [f64; 2]) {
        let touch = json!({ "enabled": true, "maxTouchPoints": 1 });
        self.call("Emulation.setTouchEmulationEnabled", touch);
        for (kind, points) in [("touchStart", json!([{ "x": x, "y": y }])), ("touchEnd", json!([]))]
        {
            let event = json!({ "type": kind, "touchPoints": points });
            self.call("Input.dispatchTouchEvent", event);
        }
    }

    /// Scrolls to the first element that matches a selector and returns the position of its centre in the window.
    #[track_caller]
    pub fn middle_of(&mut self, selector: &str) -> [f64; 2] {
        let selector = json!(selector);
        self.place(&format!(
            "(() => {{ const element = document.querySelector({selector}); \
             element.scrollIntoView({{ block: \"center\", behavior: \"instant\" }}); \
             const box = element.getBoundingClientRect(); \
             return [box.x + box.width / 2, box.y + box.height / 2]; }})()"
        ))
    }

    /// Evaluates a JavaScript expression that gives a position in the window as x and y.
    #[track_caller]
    pub fn place(&mut self, expression: &str) -> [f64; 2] {
        serde_json::from_value(self.evaluate(expression)).expect("x and y")
    }

    /// Presses and releases a key of [`KEYS`].
    pub fn key(&mut self, key: &str) {
        let known = KEYS.iter().find(|(name, ..)| *name == key);
        let (_, code, number, text) = known.unwrap_or_else(|| panic!("a new key: {key}"));
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" { text } else { "" };
            let event = json!({ "type": kind, "key": key, "code": code, "text": text,
                "windowsVirtualKeyCode": number });
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Types text into the focused element.
    pub fn text(&mut self, text: &str) {
        self.call("Input.insertText", json!({ "text": text }));
    }

    /// Returns the forbidden actions of all pages opened so far: errors, dialogs, network requests.
    pub fn problems(&self) -> Vec<String> {
        let problem = |event: &Value| {
            let params = &event["params"];
            let is_serious =
                |of: &Value| ["error", "warning", "assert"].map(Value::from).contains(of);
            let url = params["request"]["url"].as_str().unwrap_or_default();
            let is_local = ["file:", "data:", "about:"].iter().any(|kind| url.starts_with(kind));
            let is_problem = match event["method"].as_str().unwrap_or_default() {
                "Runtime.exceptionThrown" | "Page.javascriptDialogOpening" => true,
                "Runtime.consoleAPICalled" => is_serious(&params["type"]),
                "Log.entryAdded" => is_serious(&params["entry"]["level"]),
                "Network.loadingFailed" => params["canceled"] != true,
                "Network.requestWillBeSent" => !is_local,
                _ => false,
            };
            is_problem.then(|| event.to_string())
        };
        self.events.iter().filter_map(problem).collect()
    }

    /// Prints the page to PDF.
    pub fn pdf(&mut self) -> Vec<u8> {
        use base64::Engine as _;
        let printed = self.call("Page.printToPDF", json!({ "preferCSSPageSize": true }));
        let data = printed["data"].as_str().expect("a document");
        base64::engine::general_purpose::STANDARD.decode(data).expect("base64")
    }
}
