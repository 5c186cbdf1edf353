//! A headless Chromium, driven by its own `DevTools` protocol: it needs no driver beside it.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use base64::{Engine as _, prelude::BASE64_STANDARD};
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

/// How long something that a page is to do may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser that ends with its test.
pub struct Chromium {
    process: Child,
    socket: WebSocket<TcpStream>,
    sent: u64,
    tabs: BTreeMap<String, Heard>,
    _profile: tempfile::TempDir,
}

/// What was heard of a tab.
#[derive(Default)]
struct Heard {
    errors: Vec<String>,
    requests: Vec<String>,
}

/// A page that is open.
#[derive(Clone)]
pub struct Tab(String);

impl Chromium {
    /// Starts the one that `BENCH_CHROMIUM` names, or `chromium`.
    pub fn start() -> Self {
        let program = std::env::var_os("BENCH_CHROMIUM").unwrap_or_else(|| "chromium".into());
        let profile = tempfile::tempdir().unwrap();
        let mut process = Command::new(&program)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars"])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
                "--remote-debugging-port=0",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| {
                panic!("cannot start {}: {error}; tests/run sets Chromium up", program.display())
            });
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let address = lines
            .find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_owned))
            .expect("Chromium says where it listens");
        // A pipe that nobody reads fills up, and holds the browser up.
        std::thread::spawn(move || lines.for_each(drop));
        let host = address.trim_start_matches("ws://").split('/').next().unwrap();
        let stream = TcpStream::connect(host).unwrap();
        let (socket, _) = tungstenite::client(address.as_str(), stream).unwrap();
        socket.get_ref().set_read_timeout(Some(PATIENCE)).unwrap();
        Self { process, socket, sent: 0, tabs: BTreeMap::new(), _profile: profile }
    }

    /// Opens a page in a window of so many pixels.
    pub fn open(&mut self, url: &str, size: [u32; 2]) -> Tab {
        self.open_hearing(url, size, &["Page", "Runtime", "Log", "Network"])
    }

    /// The same, without being told what the page asks for and complains of: all that its sockets read would come along.
    #[allow(dead_code, reason = "the load that the live page makes is measured by it, not tested")]
    pub fn open_unheard(&mut self, url: &str, size: [u32; 2]) -> Tab {
        self.open_hearing(url, size, &["Page"])
    }

    /// Closes a page.
    #[allow(dead_code, reason = "see `open_unheard`")]
    pub fn close(&mut self, tab: &Tab) {
        self.call(Some(tab), "Page.close", &json!({}));
    }

    fn open_hearing(&mut self, url: &str, [width, height]: [u32; 2], domains: &[&str]) -> Tab {
        let target =
            self.call(None, "Target.createTarget", &json!({ "url": "about:blank", "newWindow": true }));
        let target = &target["targetId"];
        let attached =
            self.call(None, "Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        let tab = Tab(attached["sessionId"].as_str().unwrap().to_owned());
        self.tabs.insert(tab.0.clone(), Heard::default());
        for domain in domains {
            self.call(Some(&tab), &format!("{domain}.enable"), &json!({}));
        }
        self.resize(&tab, [width, height]);
        self.call(Some(&tab), "Page.navigate", &json!({ "url": url }));
        self.wait(
            &tab,
            "the page to be loaded",
            "document.readyState === 'complete' && location.href !== 'about:blank'",
        );
        tab
    }

    /// Gives the window another size.
    pub fn resize(&mut self, tab: &Tab, [width, height]: [u32; 2]) {
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600 });
        self.call(Some(tab), "Emulation.setDeviceMetricsOverride", &metrics);
    }

    /// As for a reader whose system is dark, or light.
    pub fn dark(&mut self, tab: &Tab, dark: bool) {
        let value = if dark { "dark" } else { "light" };
        let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": value }] });
        self.call(Some(tab), "Emulation.setEmulatedMedia", &features);
    }

    /// The value of an expression in the page.
    pub fn value(&mut self, tab: &Tab, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call(Some(tab), "Runtime.evaluate", &asked);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].clone()
    }

    /// Waits until an expression holds.
    pub fn wait(&mut self, tab: &Tab, what: &str, expression: &str) {
        let until = Instant::now() + PATIENCE;
        while self.value(tab, &format!("Boolean({expression})")) != true {
            if Instant::now() > until {
                self.screenshot(tab, "failed");
                panic!("waited a minute for {what}; errors of the page: {:?}", self.errors(tab));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Clicks on an element.
    pub fn click(&mut self, tab: &Tab, id: &str) {
        let shown = format!(
            "(() => {{ const e = document.getElementById('{id}'); return e && !e.disabled && e.offsetParent !== null; }})()"
        );
        self.wait(tab, &format!("#{id} to be there to be clicked"), &shown);
        self.value(tab, &format!("document.getElementById('{id}').click()"));
    }

    /// Presses the space bar, wherever the focus is.
    pub fn press_space(&mut self, tab: &Tab) {
        self.press(tab, [" ", "Space"], 32);
    }

    /// Presses a key, such as `l`, wherever the focus is. Its names are those of the DOM: what it means, and where it is.
    pub fn press(&mut self, tab: &Tab, [key, code]: [&str; 2], number: u32) {
        for kind in ["keyDown", "keyUp"] {
            let key = json!({ "type": kind, "key": key, "code": code, "windowsVirtualKeyCode": number, "text": key });
            self.call(Some(tab), "Input.dispatchKeyEvent", &key);
        }
    }

    /// Moves fingers over the page from some places to others, x and y in pixels of the window, in steps as a hand does.
    pub fn drag(&mut self, tab: &Tab, from: &[[f64; 2]], to: &[[f64; 2]]) {
        const STEPS: u32 = 10;
        self.call(
            Some(tab),
            "Emulation.setTouchEmulationEnabled",
            &json!({ "enabled": true, "maxTouchPoints": 5 }),
        );
        let mut touch = |kind: &str, share: f64| {
            let along = |(a, b): (&[f64; 2], &[f64; 2])| [0, 1].map(|i| a[i] + share * (b[i] - a[i]));
            let point = |(id, [x, y]): (usize, [f64; 2])| json!({ "x": x, "y": y, "id": id });
            let points: Vec<Value> = from.iter().zip(to).map(along).enumerate().map(point).collect();
            let points = if kind == "touchEnd" { Vec::new() } else { points };
            self.call(Some(tab), "Input.dispatchTouchEvent", &json!({ "type": kind, "touchPoints": points }));
        };
        touch("touchStart", 0.0);
        (1..=STEPS).for_each(|step| touch("touchMove", f64::from(step) / f64::from(STEPS)));
        touch("touchEnd", 1.0);
    }

    /// What is seen of the page, into the folder that `BENCH_SCREENSHOTS` names or `target/screenshots`, which CI keeps.
    pub fn screenshot(&mut self, tab: &Tab, name: &str) -> PathBuf {
        let shot = self.call(Some(tab), "Page.captureScreenshot", &json!({ "format": "png" }));
        let folder = std::env::var_os("BENCH_SCREENSHOTS").map_or_else(
            || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/screenshots"),
            PathBuf::from,
        );
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join(format!("{name}.png"));
        fs::write(&path, BASE64_STANDARD.decode(shot["data"].as_str().unwrap()).unwrap()).unwrap();
        path
    }

    /// What the page's console and scripts complain of.
    pub fn errors(&mut self, tab: &Tab) -> Vec<String> {
        // Whatever came before the answer has been heard.
        self.value(tab, "0");
        self.tabs[&tab.0].errors.clone()
    }

    /// Every address that the page has asked for.
    pub fn requests(&mut self, tab: &Tab) -> Vec<String> {
        self.value(tab, "0");
        self.tabs[&tab.0].requests.clone()
    }

    fn call(&mut self, tab: Option<&Tab>, method: &str, parameters: &Value) -> Value {
        self.sent += 1;
        let mut message = json!({ "id": self.sent, "method": method, "params": parameters });
        if let Some(Tab(session)) = tab {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let heard: Value = serde_json::from_str(&text).unwrap();
            if heard["id"] == self.sent {
                assert!(heard["error"].is_null(), "{method}: {}", heard["error"]);
                return heard["result"].clone();
            }
            self.hear(&heard);
        }
    }

    fn hear(&mut self, event: &Value) {
        let Some(tab) = event["sessionId"].as_str().and_then(|session| self.tabs.get_mut(session)) else {
            return;
        };
        let told = &event["params"];
        match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => tab.errors.push(told["exceptionDetails"].to_string()),
            Some("Runtime.consoleAPICalled") if told["type"] == "error" => {
                tab.errors.push(told["args"].to_string());
            }
            Some("Log.entryAdded") if told["entry"]["level"] == "error" => {
                tab.errors.push(told["entry"].to_string());
            }
            Some("Network.requestWillBeSent") => tab.requests.push(text(&told["request"]["url"])),
            Some("Network.webSocketCreated") => tab.requests.push(text(&told["url"])),
            _ => {}
        }
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
