//! Which board a mode is flown through: one for all, or one for each.

use std::collections::BTreeMap;

use anyhow::bail;
use bench_suite::Mode;

/// Serial ports by mode.
#[derive(Clone, Debug, Default)]
pub struct Ports {
    any: Option<String>,
    own: BTreeMap<&'static str, String>,
}

impl Ports {
    /// Ports as `--port` takes them, `PORT` or `MODE=PORT`; what is not named there is the suite's.
    pub fn new(named: &[String], of_suite: Option<&str>) -> anyhow::Result<Self> {
        let mut ports = Self::default();
        for text in named {
            // Names of devices may hold an equals sign as well.
            let own = [Mode::Loopback, Mode::Transmitter]
                .into_iter()
                .find_map(|mode| Some((mode, text.strip_prefix(mode.name())?.strip_prefix('=')?)));
            let before = match own {
                Some((mode, port)) => ports.own.insert(mode.name(), port.to_owned()),
                None => ports.any.replace(text.clone()),
            };
            if let Some(before) = before {
                bail!(
                    "--port {text}: {before} was named before; give one port for all modes, and at most one for each"
                );
            }
        }
        ports.any = ports.any.or_else(|| of_suite.map(str::to_owned));
        Ok(ports)
    }

    /// The port of the board that a mode is flown through.
    pub fn of(&self, mode: Mode) -> Option<&str> {
        self.own.get(mode.name()).or(self.any.as_ref()).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ports(named: &[&str], of_suite: Option<&str>) -> anyhow::Result<Ports> {
        let named: Vec<String> = named.iter().map(|text| (*text).to_owned()).collect();
        Ports::new(&named, of_suite)
    }

    #[test]
    fn a_mode_has_its_own_port_or_that_of_all() {
        let both = ports(&["loopback=/dev/by-id/a=b", "/dev/c"], Some("/dev/d")).unwrap();
        assert_eq!(both.of(Mode::Loopback), Some("/dev/by-id/a=b"));
        assert_eq!(both.of(Mode::Transmitter), Some("/dev/c"));
        let one = ports(&["transmitter=/dev/b"], Some("/dev/d")).unwrap();
        assert_eq!(one.of(Mode::Loopback), Some("/dev/d"));
        assert_eq!(ports(&["transmitter=/dev/b"], None).unwrap().of(Mode::Loopback), None);
        // A device whose name only begins like a mode.
        assert_eq!(ports(&["loopback-board"], None).unwrap().of(Mode::Loopback), Some("loopback-board"));
        for twice in [["/dev/a", "/dev/b"], ["loopback=/dev/a", "loopback=/dev/b"]] {
            assert!(ports(&twice, None).unwrap_err().to_string().contains("/dev/a was named before"));
        }
    }
}
