use std::{fmt, str::FromStr};

/// What the controller is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Phase {
    /// On the ground, outputs at rest.
    #[default]
    Idle,
    /// Timed open-loop throttle that carries the airframe out of the ground effect.
    Launch,
    /// Open-loop throttle without a hand-over (hops, identification flights).
    Open,
    /// Closed loop on the mission's set-points.
    Hold,
    /// Closed loop down, then throttle to rest.
    Land,
    /// A safety stop: throttle to rest, whatever the mission says.
    Abort,
}

impl Phase {
    /// All phases, in the order in which a mission may go through them.
    pub const ALL: [Self; 6] = [Self::Idle, Self::Launch, Self::Open, Self::Hold, Self::Land, Self::Abort];

    /// The name used in mission files, recordings and on the screen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Launch => "launch",
            Self::Open => "open",
            Self::Hold => "hold",
            Self::Land => "land",
            Self::Abort => "abort",
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// No phase has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no phase is called {0:?}; there are idle, launch, open, hold, land and abort")]
pub struct UnknownPhase(pub String);

impl FromStr for Phase {
    type Err = UnknownPhase;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|phase| phase.name() == name).ok_or_else(|| UnknownPhase(name.to_owned()))
    }
}
