-- A flight test for ArduPilot Plane 4.5 or newer. Written by a ground station; see the table of settings below.
--
-- Set RCn_OPTION of a switch to the scripting function below (300 is Scripting1), SCR_ENABLE to 1, and copy this file to
-- APM/scripts. Trim the aircraft in one of the modes below, high enough, then put the switch high. Each manoeuvre is
-- added to the mean servo outputs of the second before it; between manoeuvres the autopilot flies.
-- The script lets go at once when the switch leaves high, when the vehicle is disarmed, changes its mode, banks or
-- pitches too far or is too low. It begins again only after the switch has been low. Should the script itself stop, the
-- autopilot has the servos back after TIMEOUT_MS.

--@SETTINGS@

local PERIOD_MS = math.floor(1000 / RATE_HZ)
local TIMEOUT_MS = 5 * PERIOD_MS
local MEMORY_S = 1.0 -- of the mean of the servo outputs
local INFO, ALERT = 6, 1

local trim = {} -- channel from 1 -> us, mean while the autopilot flies
local started = nil -- time of the switch going high, ms
local place = 0 -- segment being flown; 0 before the first
local streams = {}
local rested = false -- the switch has been low

local function say(level, text)
   gcs:send_text(level, "flight test: " .. text)
end

-- Newer versions name the unit; the older name serves the others.
local function angle(newer, older)
   if pcall(function() return ahrs[newer](ahrs) end) then
      return function() return ahrs[newer](ahrs) end
   end
   return function() return ahrs[older](ahrs) end
end

local roll = angle("get_roll_rad", "get_roll")
local pitch = angle("get_pitch_rad", "get_pitch")

-- Reads "12x25 -3 0": offsets in us, each with the number of samples that it lasts; the last one stays.
local function stream(text)
   local tokens = string.gmatch(text, "(%-?%d+)x?(%d*)")
   local value, last = 0, -1
   return function(sample)
      while last < sample do
         local offset, count = tokens()
         if offset == nil then
            last = math.huge
         else
            value = tonumber(offset)
            last = last + (tonumber(count) or 1)
         end
      end
      return value
   end
end

local function switch_high()
   local channel = rc:find_channel_for_option(SWITCH_FUNCTION)
   return channel ~= nil and channel:get_aux_switch_pos() == 2
end

-- Why nothing may be flown now, or nil.
local function objection()
   if not switch_high() then
      return "switched off"
   elseif not arming:is_armed() then
      return "not armed"
   elseif not MODES[vehicle:get_mode()] then
      return "not in its mode"
   elseif math.abs(roll()) > LARGEST_ROLL or math.abs(pitch()) > LARGEST_PITCH then
      return "bank or pitch too large"
   elseif -ahrs:get_relative_position_D_home() < LOWEST_M then
      return "too low"
   end
   return nil
end

local function follow_trim()
   for channel in pairs(RANGES) do
      local pwm = SRV_Channels:get_output_pwm_chan(channel - 1)
      if pwm ~= nil and pwm > 0 then
         local old = trim[channel] or pwm
         trim[channel] = old + (pwm - old) / (MEMORY_S * RATE_HZ)
      end
   end
end

local function begin(number)
   place = number
   streams = {}
   for channel, text in pairs(SEGMENTS[number].offsets) do
      streams[channel] = stream(text)
   end
   say(INFO, SEGMENTS[number].name)
end

local function fly(segment, elapsed)
   local sample = math.floor((elapsed - segment.from) * RATE_HZ + 0.01)
   for _, channel in ipairs(segment.held) do
      local base = trim[channel]
      if base ~= nil then
         local offset = streams[channel] and streams[channel](sample) or 0
         local pwm = base + offset - (LEVEL[channel] or 0) * roll()
         local range = RANGES[channel]
         pwm = math.floor(math.min(math.max(pwm, range[1]), range[2]) + 0.5)
         SRV_Channels:set_output_pwm_chan_timeout(channel - 1, pwm, TIMEOUT_MS)
      end
   end
end

local function stop(level, text)
   started, place = nil, 0
   rested = false
   say(level, text)
end

local function update()
   if not switch_high() then
      rested = true
   end
   if started == nil then
      follow_trim()
      if not (rested and switch_high()) then
         return update, PERIOD_MS
      end
      local reason = objection()
      if reason ~= nil then
         stop(ALERT, reason)
         return update, PERIOD_MS
      end
      started = millis()
      say(INFO, "begins")
   end
   local reason = objection()
   if reason ~= nil then
      stop(ALERT, "ended, " .. reason)
      return update, PERIOD_MS
   end
   local elapsed = (millis() - started):tofloat() * 0.001
   if elapsed >= END_S then
      stop(INFO, "done")
      return update, PERIOD_MS
   end
   local now = nil
   for number, segment in ipairs(SEGMENTS) do
      if elapsed >= segment.from and elapsed < segment.to then
         now = number
      end
   end
   if now == nil then
      place = 0
      follow_trim()
   else
      if place ~= now then
         begin(now)
      end
      fly(SEGMENTS[now], elapsed)
   end
   return update, PERIOD_MS
end

say(INFO, string.format("%d manoeuvres, %.0f s", #SEGMENTS, END_S))
return update, 1000
