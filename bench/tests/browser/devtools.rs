//! A headless Chromium, driven by the DevTools protocol over two pipes: windows of any size, dark and printed pages, keys
//! and the mouse.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

/// How a page is shown.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Screen {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) is_dark: bool,
    pub(crate) is_print: bool,
    /// Whether the reader asked for less motion.
    pub(crate) is_calm: bool,
}

impl Screen {
    /// A light screen of this width.
    pub(crate) const fn wide(width: u32) -> Self {
        Self { width, height: 900, is_dark: false, is_print: false, is_calm: false }
    }

    /// What a page has to look right on: three widths, light and dark, and A4 paper between its margins.
    pub(crate) fn all() -> Vec<Self> {
        let widths = [390, 800, 1400].map(Self::wide);
        let dark = widths.map(|screen| Self { is_dark: true, ..screen });
        let paper = Self { is_print: true, ..Self::wide(688) };
        [&widths[..], &dark[..], &[paper]].concat()
    }
}

/// What draws WebGL.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Graphics {
    /// SwiftShader, which needs no GPU.
    Software,
    /// Nothing.
    None,
}

pub(crate) struct Browser {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: Option<Value>,
    calls: u64,
    /// Events since the last page was opened.
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

impl Browser {
    pub(crate) fn new(graphics: Graphics) -> Self {
        let program = std::env::var_os("CHROMIUM")
            .expect("CHROMIUM names the browser; `scripts/dev.sh browser` sets it");
        let profile = tempfile::tempdir().unwrap();
        let drawing: &[&str] = match graphics {
            Graphics::Software => {
                &["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
            }
            Graphics::None => &["--disable-gpu", "--disable-software-rasterizer"],
        };
        // The browser reads commands from file 3 and writes answers to file 4.
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1"])
            .arg(program)
            .args([
                "--headless",
                "--no-sandbox",
                "--remote-debugging-pipe",
                "--no-first-run",
                "--hide-scrollbars",
            ])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-quic"])
            .args(["--disable-sync", "--force-color-profile=srgb"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .args(drawing)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, from) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let mut browser = Self {
            process,
            to,
            from: BufReader::new(from),
            session: None,
            calls: 0,
            events: Vec::new(),
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        browser.session = Some(attached["sessionId"].clone());
        for method in ["Page.enable", "Runtime.enable", "Log.enable"] {
            browser.call(method, json!({}));
        }
        browser
    }

    /// Calls a method of the protocol and returns its result.
    pub(crate) fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut message = json!({"id": self.calls, "method": method, "params": parameters});
        if let Some(session) = &self.session {
            message["sessionId"] = session.clone();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let heard = self.next();
            if heard["id"] == self.calls {
                assert!(heard["error"].is_null(), "{method}: {}", heard["error"]);
                return heard["result"].clone();
            }
            self.events.push(heard);
        }
    }

    fn next(&mut self) -> Value {
        let mut bytes = Vec::new();
        self.from.read_until(0, &mut bytes).unwrap();
        assert_eq!(bytes.pop(), Some(0), "the browser is gone");
        serde_json::from_slice(&bytes).unwrap()
    }

    /// Opens a file, with what follows `#` in its address; waits until it is loaded and laid out.
    pub(crate) fn open(&mut self, page: &Path, at: &str, screen: Screen) {
        self.open_address(&format!("file://{}{at}", page.display()), screen);
    }

    /// Opens an address; waits until the page is loaded and laid out.
    pub(crate) fn open_address(&mut self, address: &str, screen: Screen) {
        let Screen { width, height, is_dark, is_print, is_calm } = screen;
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false});
        self.call("Emulation.setDeviceMetricsOverride", size);
        let feature = |name: &str, value: &str| json!({"name": name, "value": value});
        let features = [
            feature("prefers-color-scheme", if is_dark { "dark" } else { "light" }),
            feature("prefers-reduced-motion", if is_calm { "reduce" } else { "no-preference" }),
        ];
        let media = json!({"media": if is_print { "print" } else { "" }, "features": features});
        self.call("Emulation.setEmulatedMedia", media);
        // An address that differs behind `#` only would not load again.
        self.events.clear();
        self.call("Page.navigate", json!({"url": "about:blank"}));
        self.loaded();
        self.events.clear();
        self.call("Page.navigate", json!({"url": address}));
        self.loaded();
        self.eval("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))");
    }

    /// Waits until a page is loaded.
    pub(crate) fn loaded(&mut self) {
        while !self.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            let event = self.next();
            self.events.push(event);
        }
    }

    /// Forgets the events so far, to wait for those of the next page.
    pub(crate) fn forget(&mut self) {
        self.events.clear();
    }

    /// Evaluates an expression in the page; a promise until it is fulfilled.
    pub(crate) fn eval(&mut self, expression: &str) -> Value {
        let parameters = json!({"expression": expression, "returnByValue": true, "awaitPromise": true, "userGesture": true});
        let found = self.call("Runtime.evaluate", parameters);
        assert!(found["exceptionDetails"].is_null(), "{expression}: {}", found["exceptionDetails"]);
        found["result"]["value"].clone()
    }

    pub(crate) fn text(&mut self, selector: &str) -> String {
        let found = self.eval(&format!("document.querySelector({selector:?}).textContent"));
        found.as_str().unwrap().to_owned()
    }

    /// Presses a key by its name in the DOM.
    pub(crate) fn press(&mut self, key: &str) {
        // Only a key with a text types.
        let text = if key.chars().count() == 1 { json!(key) } else { Value::Null };
        let mut down = json!({"type": "keyDown", "key": key});
        if !text.is_null() {
            down["text"] = text;
        }
        self.call("Input.dispatchKeyEvent", down);
        self.call("Input.dispatchKeyEvent", json!({"type": "keyUp", "key": key}));
    }

    /// Clicks into an element, at this share of its width.
    pub(crate) fn click(&mut self, selector: &str, share: f64) {
        let at = self.eval(&format!(
            "(() => {{ const e = document.querySelector({selector:?}); e.scrollIntoView({{block: 'center'}}); \
             const box = e.getBoundingClientRect(); return [box.left + box.width * {share}, box.top + box.height / 2]; }})()"
        ));
        for kind in ["mousePressed", "mouseReleased"] {
            let mut event = json!({"type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1});
            event["buttons"] = json!(u8::from(kind == "mousePressed"));
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// Messages of the page's console, and errors of its scripts.
    pub(crate) fn console(&self) -> Vec<&Value> {
        const SAID: [&str; 3] = ["Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"];
        let is_said = |event: &&Value| SAID.iter().any(|method| event["method"] == *method);
        self.events.iter().filter(is_said).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
