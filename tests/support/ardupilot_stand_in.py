"""What a flight test script calls of ArduPilot's scripting interface, with the aircraft's state set by a test."""

from __future__ import annotations

from dataclasses import dataclass, field

from lupa.lua53 import LuaRuntime

# Names, arguments and returned types as in ArduPilot's documented scripting interface (docs.lua).
_STUBS = """
local state = ...
local clock = {}
clock.__index = clock
function clock.__sub(a, b) return setmetatable({ms = a.ms - b.ms}, clock) end
function clock:tofloat() return self.ms + 0.0 end
function millis() return setmetatable({ms = state.ms}, clock) end
gcs = {}
function gcs:send_text(level, text) assert(#text <= 50); state.said(level, text) end
arming = {}
function arming:is_armed() return state.armed end
vehicle = {}
function vehicle:get_mode() return state.mode end
rc = {}
function rc:find_channel_for_option(option)
   if option ~= 300 then return nil end
   return {get_aux_switch_pos = function(self) return state.switch end}
end
ahrs = {}
if state.named_by_unit then
   function ahrs:get_roll_rad() return state.roll end
   function ahrs:get_pitch_rad() return state.pitch end
else
   function ahrs:get_roll() return state.roll end
   function ahrs:get_pitch() return state.pitch end
end
function ahrs:get_relative_position_D_home() return -state.height end
SRV_Channels = {}
function SRV_Channels:get_output_pwm_chan(channel) return state.outputs[channel] end
function SRV_Channels:set_output_pwm_chan_timeout(channel, pwm, timeout)
   assert(math.type(channel) == "integer" and math.type(pwm) == "integer" and math.type(timeout) == "integer")
   state.set(channel, pwm, timeout)
end
"""


@dataclass
class StandIn:
    """Runs one script. outputs: servo from 1 -> us that the autopilot gives; `taken`: what the script last set."""

    outputs: dict[int, int]
    named_by_unit: bool = True
    taken: dict[int, int] = field(default_factory=dict)
    timeouts: set[int] = field(default_factory=set)
    messages: list[str] = field(default_factory=list)

    def load(self, script: str) -> None:
        """Begin as the autopilot does: run the file, keep the function that it returns."""
        self._lua = LuaRuntime(unpack_returned_tuples=True)
        self.state = self._lua.table(
            ms=0, armed=True, mode=7, switch=0, roll=0.0, pitch=0.0, height=100.0, named_by_unit=self.named_by_unit,
            said=lambda level, text: self.messages.append(text), set=self._set,
            outputs=self._lua.table_from({servo - 1: us for servo, us in self.outputs.items()}),
        )  # fmt: skip
        self._lua.execute(_STUBS, self.state)
        self._update, _ = self._lua.execute(script)

    def _set(self, channel: int, pwm: int, timeout: int) -> None:
        self.taken[channel + 1] = pwm
        self.timeouts.add(timeout)

    def tick(self, ms: int = 20) -> dict[int, int]:
        """Call the script once, `ms` after the last call; what it set."""
        self.state.ms += ms
        self.taken = {}
        self._update, _ = self._update()
        return self.taken
