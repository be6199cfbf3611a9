-- Wireshark dissector for the skill process image. Made from the tables of the image (crate `protocol`): do not edit.
--
--   tshark -X lua_script:skillbench-image.lua -r capture.pcapng -V
--   or copy it into Wireshark's folder of personal Lua plugins (Help, About Wireshark, Folders)
--
-- It finds the 256 bytes of an image by their check (CRC-32C), in cyclic data of PROFINET (EtherType 0x8892 and UDP port 34962),
-- of EtherNet/IP (UDP port 2222) and of EtherCAT (logical addresses). Where an image was found, it is shown in all later frames
-- of the same sender and FrameID, connection or address, with a right check or a wrong one. A sender that leaves the check out
-- (0) is not found.

local image = Proto("skillbench", "Skill process image")

-- The tables ---------------------------------------------------------------------------------------------------------------

local LEN, MOTION_LEN, KIND_AT = 256, 44, 42
local CHECK_OF_COMMAND, CHECK_OF_FEEDBACK = 32, 116
local LIFE_OF_COMMAND, LIFE_OF_FEEDBACK = 2, 24
local COMMAND_CODES = {
    [0] = "None",
    [1] = "MoveLinCartesian",
    [2] = "MovePtpCartesian",
    [3] = "MovePtpJoint",
    [4] = "MoveCircular",
    [5] = "MoveSpline",
    [6] = "MoveLinForceCartesian",
    [16] = "MoveContinuous",
    [17] = "RunProgram",
    [18] = "MoveTrajectory",
}
local FEEDBACK_CODES = {
    [0] = "Halted",
    [1] = "Ready",
    [2] = "Running",
    [3] = "Suspended",
}
local KINDS_OF_MOTION = {
    [0] = "None",
    [1] = "LinCartesian",
    [2] = "PtpCartesian",
    [3] = "PtpJoint",
    [4] = "Circular",
    [5] = "Spline",
    [6] = "LinForceCartesian",
}
local ERRORS = {
    [0] = "None",
    [1] = "UnknownSkill",
    [2] = "UnknownMotionKind",
    [3] = "MotionKindNotSupported",
    [4] = "NotReady",
    [5] = "UnknownProgram",
    [6] = "NoMotions",
    [7] = "QueueOverrun",
    [8] = "UnknownTool",
    [9] = "UnknownBase",
    [10] = "VelocityOutOfRange",
    [11] = "AccelerationOutOfRange",
    [12] = "OverrideOutOfRange",
    [13] = "TargetNotFinite",
    [14] = "Unreachable",
    [15] = "AxisLimit",
    [16] = "Singular",
    [17] = "ConnectionLost",
    [18] = "Disabled",
    [19] = "ConfigurationChange",
    [20] = "ZeroLength",
    [21] = "CollinearCircle",
    [22] = "ForceOutOfRange",
    [23] = "ForceDirection",
    [24] = "ForceNotReached",
    [25] = "JointSpeed",
    [26] = "JointAcceleration",
    [27] = "JointJerk",
    [28] = "ConfigurationMismatch",
    [29] = "DecelerationOutOfRange",
    [30] = "JerkOutOfRange",
    [31] = "WrongCheck",
    [32] = "DriveFault",
    [33] = "DriveStopped",
    [34] = "DrivesLost",
    [35] = "TurnTooFast",
    [36] = "ForceUnsteady",
    [37] = "NotOneMotion",
    [38] = "WrongLifeCounter",
    [39] = "FollowingError",
    [40] = "DriveNotArrived",
    [41] = "DriveNotOn",
    [42] = "NotServed",
    [43] = "CompactNotServed",
    [44] = "PointHead",
}
local COMMAND = {
    { first = 0, len = 2, name = "control", unit = "bits", form = "word", bits = { "ENABLE", "EXECUTE", "HALT", "SUSPEND", "RESUME", "RESET", "CANCEL", "SYNC", "COMPACT" } },
    { first = 2, len = 2, name = "life counter", unit = "", form = "uint" },
    { first = 4, len = 2, name = "command number", unit = "", form = "uint" },
    { first = 6, len = 1, name = "skill", unit = "", form = "code", codes = COMMAND_CODES },
    { first = 7, len = 1, name = "override", unit = "%", form = "usint" },
    { first = 8, len = 4, name = "total", unit = "motions", form = "udint" },
    { first = 12, len = 4, name = "written", unit = "motions", form = "udint" },
    { first = 16, len = 2, name = "program number", unit = "", form = "uint" },
    { first = 18, len = 2, name = "digital outputs", unit = "bits", form = "word", bits = {  } },
    { first = 20, len = 8, name = "start time", unit = "ns", form = "ulint" },
    { first = 28, len = 4, name = "law time", unit = "µs", form = "udint" },
    { first = 32, len = 4, name = "check", unit = "", form = "check" },
    { first = 36, len = 44, name = "slot 0", unit = "", form = "motion" },
    { first = 80, len = 44, name = "slot 1", unit = "", form = "motion" },
    { first = 124, len = 44, name = "slot 2", unit = "", form = "motion" },
    { first = 168, len = 44, name = "slot 3", unit = "", form = "motion" },
    { first = 212, len = 44, name = "slot 4", unit = "", form = "motion" },
}
local FEEDBACK = {
    { first = 0, len = 2, name = "status", unit = "bits", form = "word", bits = { "BUSY", "DONE", "ABORTED", "ERROR", "AT_REST", "ENABLED", "WARNING" } },
    { first = 2, len = 1, name = "state", unit = "", form = "code", codes = FEEDBACK_CODES },
    { first = 3, len = 1, name = "override", unit = "%", form = "usint" },
    { first = 4, len = 2, name = "command number", unit = "", form = "uint" },
    { first = 6, len = 2, name = "error number", unit = "", form = "code", codes = ERRORS },
    { first = 8, len = 4, name = "executed", unit = "motions", form = "udint" },
    { first = 12, len = 4, name = "accepted", unit = "motions", form = "udint" },
    { first = 16, len = 4, name = "error motion", unit = "", form = "udint" },
    { first = 20, len = 2, name = "digital inputs", unit = "bits", form = "word", bits = {  } },
    { first = 22, len = 2, name = "life counter echo", unit = "", form = "uint" },
    { first = 24, len = 2, name = "life counter", unit = "", form = "uint" },
    { first = 26, len = 2, name = "blends suppressed", unit = "motions", form = "uint" },
    { first = 28, len = 8, name = "clock", unit = "ns", form = "ulint" },
    { first = 36, len = 8, name = "execution time", unit = "ns", form = "ulint" },
    { first = 44, len = 24, name = "joints", unit = "degrees (mm)", form = "real" },
    { first = 68, len = 24, name = "pose", unit = "mm, degrees", form = "real" },
    { first = 92, len = 4, name = "path speed", unit = "mm/s", form = "real" },
    { first = 96, len = 4, name = "contact force", unit = "N", form = "real" },
    { first = 100, len = 1, name = "error index", unit = "", form = "usint" },
    { first = 101, len = 3, name = "reserved", unit = "", form = "reserved" },
    { first = 104, len = 4, name = "error value", unit = "by the error", form = "real" },
    { first = 108, len = 4, name = "error lower limit", unit = "by the error", form = "real" },
    { first = 112, len = 4, name = "error upper limit", unit = "by the error", form = "real" },
    { first = 116, len = 4, name = "check", unit = "", form = "check" },
    { first = 120, len = 4, name = "law time", unit = "µs", form = "udint" },
    { first = 124, len = 2, name = "queue depth", unit = "motions", form = "uint" },
    { first = 126, len = 2, name = "services", unit = "bits", form = "word", bits = { "SYNC", "COMPACT", "KEEPS_ACCEPTED" } },
    { first = 128, len = 128, name = "reserved", unit = "", form = "reserved" },
}
local MOTION = {
    { first = 0, len = 24, name = "target", unit = "mm, degrees", form = "real" },
    { first = 24, len = 12, name = "auxiliary", unit = "mm or N", form = "real" },
    { first = 36, len = 2, name = "velocity", unit = "0.1 mm/s or 0.01 %", form = "uint" },
    { first = 38, len = 2, name = "acceleration", unit = "1 mm/s² or 0.01 %", form = "uint" },
    { first = 40, len = 2, name = "approximation", unit = "0.01 mm", form = "uint" },
    { first = 42, len = 1, name = "kind", unit = "", form = "code", codes = KINDS_OF_MOTION },
    { first = 43, len = 1, name = "tool and base", unit = "", form = "usint" },
}
local OPTIONS = {
    { first = 24, len = 1, name = "status", unit = "", form = "usint" },
    { first = 25, len = 1, name = "turn", unit = "", form = "usint" },
    { first = 26, len = 2, name = "deceleration", unit = "1 mm/s² or 0.01 %", form = "uint" },
    { first = 28, len = 2, name = "jerk", unit = "10 mm/s³ or 0.01 %", form = "uint" },
    { first = 30, len = 6, name = "reserved", unit = "", form = "reserved" },
}
local COMPACT = {
    { first = 36, len = 24, name = "origin", unit = "mm, degrees", form = "real" },
    { first = 60, len = 2, name = "velocity", unit = "0.1 mm/s", form = "uint" },
    { first = 62, len = 2, name = "acceleration", unit = "1 mm/s²", form = "uint" },
    { first = 64, len = 2, name = "deceleration", unit = "1 mm/s²", form = "uint" },
    { first = 66, len = 2, name = "jerk", unit = "10 mm/s³", form = "uint" },
    { first = 68, len = 2, name = "zone", unit = "0.01 mm", form = "uint" },
    { first = 70, len = 1, name = "kind", unit = "", form = "code", codes = KINDS_OF_MOTION },
    { first = 71, len = 1, name = "tool and base", unit = "", form = "usint" },
    { first = 72, len = 2, name = "resolution", unit = "0.01 µm, 0.00001 degrees", form = "uint" },
    { first = 74, len = 1, name = "coordinates", unit = "", form = "usint" },
    { first = 75, len = 1, name = "content", unit = "", form = "usint" },
    { first = 76, len = 180, name = "ring", unit = "steps", form = "int" },
}
local SKILL_AT, COMPACT_SKILL, COMPACT_BIT = 6, 18, 256
local POINT = {
    { first = 24, len = 12, name = "point", unit = "mm", form = "real" },
}
local FORCE = {
    { first = 24, len = 12, name = "force", unit = "N", form = "real" },
}
local AUXILIARY = { [1] = OPTIONS, [2] = OPTIONS, [3] = OPTIONS, [4] = POINT, [5] = OPTIONS, [6] = FORCE, }

-- The protocol's fields -----------------------------------------------------------------------------------------------------

local CHECK_STATES = { [0] = "none", [1] = "right", [2] = "wrong" }
local registered = {}

local function register(field)
    registered[#registered + 1] = field
    return field
end

local function label(row)
    local name = row.name:sub(1, 1):upper() .. row.name:sub(2)
    if row.unit == "" or row.unit == "bits" then return name end
    return name .. " [" .. row.unit .. "]"
end

local function field_of(row, filter)
    local text = label(row)
    local numbers = { usint = ProtoField.uint8, uint = ProtoField.uint16, udint = ProtoField.uint32 }
    if row.codes then
        return (row.len == 1 and ProtoField.uint8 or ProtoField.uint16)(filter, text, base.DEC, row.codes)
    elseif row.form == "ulint" then
        return ProtoField.uint64(filter, text, base.DEC)
    elseif row.form == "real" then
        return ProtoField.float(filter, text)
    elseif row.form == "int" then
        return ProtoField.int16(filter, text, base.DEC)
    elseif row.form == "word" then
        return ProtoField.uint16(filter, text, base.HEX)
    elseif row.form == "check" then
        return ProtoField.uint32(filter, text, base.HEX)
    end
    return numbers[row.form](filter, text, base.DEC)
end

local function prepare(rows, prefix)
    for _, row in ipairs(rows) do
        if row.form ~= "reserved" and row.form ~= "motion" then
            local filter = prefix .. "." .. row.name:gsub(" ", "_")
            row.field = register(field_of(row, filter))
            row.bit_fields = {}
            for index, name in ipairs(row.bits or {}) do
                local mask = 2 ^ (index - 1)
                row.bit_fields[index] =
                    register(ProtoField.bool(filter .. "." .. name:lower(), name, 16, nil, mask))
            end
        end
    end
end

prepare(COMMAND, "skillbench.command")
prepare(FEEDBACK, "skillbench.feedback")
prepare(MOTION, "skillbench.motion")
prepare(OPTIONS, "skillbench.motion")
prepare(POINT, "skillbench.motion")
prepare(COMPACT, "skillbench.points")
prepare(FORCE, "skillbench.motion")
local check_state = register(ProtoField.uint8("skillbench.check_state", "State of the check", base.DEC, CHECK_STATES))
image.fields = registered

local wrong_check = ProtoExpert.new("skillbench.wrong_check", "The check is wrong: receivers refuse this image",
    expert.group.CHECKSUM, expert.severity.WARN)
image.experts = { wrong_check }

-- The check -----------------------------------------------------------------------------------------------------------------

local bxor = bit32 and bit32.bxor or bit and bit.bxor or load("return function(a, b) return a ~ b end")()
local WORDS = 2 ^ 32
local CRC = {}
for byte = 0, 255 do
    local value = byte
    for _ = 1, 8 do
        local low = value % 2
        value = (value - low) / 2
        if low == 1 then value = bxor(value, 0x82F63B78) % WORDS end
    end
    CRC[byte] = value
end

-- Returns the check of the image at `at` (from 0) of `data`, over the bytes after the check and then those before it.
local function check_of(data, at, kind)
    local sum = WORDS - 1
    local function add(from, until_)
        for index = at + from + 1, at + until_ do
            sum = bxor((sum - sum % 256) / 256, CRC[bxor(sum % 256, data:byte(index)) % 256]) % WORDS
        end
    end
    add(kind.check + 4, LEN)
    add(0, kind.check)
    sum = bxor(sum, WORDS - 1) % WORDS
    return sum == 0 and WORDS - 1 or sum
end

local function number(data, at, len, is_little)
    local value = 0
    for index = 1, len do
        value = value * 256 + data:byte(at + (is_little and len + 1 - index or index))
    end
    return value
end

-- Finding images ------------------------------------------------------------------------------------------------------------

-- Frames in which every place of a stream is tried; after them every sixteenth.
local THOROUGH = 500

local KINDS = {
    { name = "Command", rows = COMMAND, check = CHECK_OF_COMMAND, life = LIFE_OF_COMMAND, codes_at = 6,
        codes = COMMAND_CODES },
    { name = "Feedback", rows = FEEDBACK, check = CHECK_OF_FEEDBACK, life = LIFE_OF_FEEDBACK, codes_at = 2,
        codes = FEEDBACK_CODES },
}

local streams = {}

function image.init() streams = {} end

-- Returns whether these bytes are an image with a right check. What is cheap is asked first. The life counter must have moved:
-- between two images that are zero but for their checks, other 256 bytes have a right check, too.
local function is_image(data, at, kind, is_little)
    if not kind.codes[data:byte(at + kind.codes_at + 1)] then return false end
    if number(data, at + kind.life, 2, is_little) == 0 then return false end
    local given = number(data, at + kind.check, 4, is_little)
    return given ~= 0 and given == check_of(data, at, kind)
end

local function search(data, is_little)
    local found, at = {}, 0
    while at + LEN <= #data do
        local kind
        for _, candidate in ipairs(KINDS) do
            if is_image(data, at, candidate, is_little) then kind = candidate end
        end
        if kind then found[#found + 1] = { at = at, kind = kind } end
        at = at + (kind and LEN or 1)
    end
    return found
end

-- Adds places that were not known.
local function learn(places, found)
    for _, place in ipairs(found) do
        local is_known = false
        for _, known in ipairs(places) do
            is_known = is_known or (known.at == place.at and known.kind == place.kind)
        end
        if not is_known then places[#places + 1] = place end
    end
end

local function places_in(key, data, is_little)
    local stream = streams[key]
    if not stream then
        stream = { places = {}, frames = 0 }
        streams[key] = stream
    end
    stream.frames = stream.frames + 1
    if stream.frames <= THOROUGH and #stream.places == 0 or stream.frames % 16 == 0 and #stream.places == 0
        or stream.frames % 256 == 0 then
        learn(stream.places, search(data, is_little))
    end
    return stream.places
end

-- Showing images ------------------------------------------------------------------------------------------------------------

local show_motion

local function show_rows(tree, rows, tvb, at, is_little)
    for _, row in ipairs(rows) do
        local first, add = at + row.first, is_little and tree.add_le or tree.add
        if row.form == "motion" then
            show_motion(tree, tvb, first, is_little, row.name)
        elseif row.form == "real" then
            for index = 0, row.len / 4 - 1 do
                add(tree, row.field, tvb(first + 4 * index, 4))
            end
        elseif row.form == "int" then
            for index = 0, row.len / 2 - 1 do
                add(tree, row.field, tvb(first + 2 * index, 2))
            end
        elseif row.form ~= "reserved" then
            local item = add(tree, row.field, tvb(first, row.len))
            for _, bit_field in ipairs(row.bit_fields) do
                (is_little and item.add_le or item.add)(item, bit_field, tvb(first, row.len))
            end
        end
    end
end

show_motion = function(tree, tvb, at, is_little, name)
    local kind = tvb(at + KIND_AT, 1):uint()
    local branch = tree:add(image, tvb(at, MOTION_LEN), name:sub(1, 1):upper() .. name:sub(2) .. ": " ..
        (KINDS_OF_MOTION[kind] or "kind " .. kind))
    if kind == 0 then return end
    for _, row in ipairs(MOTION) do
        local rows = row.name == "auxiliary" and AUXILIARY[kind] or { row }
        show_rows(branch, rows, tvb, at, is_little)
    end
end

-- The fields of a command with compact points in place of motions.
local COMMAND_WITH_POINTS = {}
for _, row in ipairs(COMMAND) do
    if row.form ~= "motion" then COMMAND_WITH_POINTS[#COMMAND_WITH_POINTS + 1] = row end
end
for _, row in ipairs(COMPACT) do COMMAND_WITH_POINTS[#COMMAND_WITH_POINTS + 1] = row end

-- Returns whether an image is a command with compact points: by its skill and the control bit.
local function is_compact(data, kind, is_little)
    if kind.rows ~= COMMAND or data:byte(SKILL_AT + 1) ~= COMPACT_SKILL then return false end
    return math.floor(number(data, 0, 2, is_little) / COMPACT_BIT) % 2 == 1
end

local function show(tvb, pinfo, tree, place, is_little)
    local at, kind = place.at, place.kind
    local data = tvb:raw(at, LEN)
    local given = number(data, kind.check, 4, is_little)
    local state = given == 0 and 0 or given == check_of(data, 0, kind) and 1 or 2
    local branch = tree:add(image, tvb(at, LEN), "Skill process image, " .. kind.name)
    show_rows(branch, is_compact(data, kind, is_little) and COMMAND_WITH_POINTS or kind.rows, tvb, at, is_little)
    local item = branch:add(check_state, tvb(at + kind.check, 4), state):set_generated()
    if state == 2 then item:add_proto_expert_info(wrong_check) end
    local count = is_little and tvb(at + 8, 4):le_uint() or tvb(at + 8, 4):uint()
    local code = kind.codes[tvb(at + kind.codes_at, 1):uint()] or "?"
    local command = is_little and tvb(at + 4, 2):le_uint() or tvb(at + 4, 2):uint()
    pinfo.cols.info:append(string.format(" | %s: number %d, %s, %s %d", kind.name, command, code,
        kind.name == "Command" and "total" or "executed", count))
end

-- Shows the images among the bytes from `at` to before `until_`.
local function show_all(tvb, pinfo, tree, key, at, until_, is_little, is_shown)
    if until_ - at < LEN then return end
    for _, place in ipairs(places_in(key, tvb:raw(at, until_ - at), is_little)) do
        local first = at + place.at
        if first + LEN <= until_ and (not is_shown or is_shown(place.kind)) then
            show(tvb, pinfo, tree, { at = first, kind = place.kind }, is_little)
        end
    end
end

-- Frames --------------------------------------------------------------------------------------------------------------------

-- PROFINET: FrameID, then data of all submodules with their states.
local function profinet(tvb, pinfo, tree, at, sender)
    if tvb:len() < at + 2 then return end
    local key = "pn " .. sender .. tvb(at, 2):uint()
    show_all(tvb, pinfo, tree, key, at + 2, tvb:len(), false)
end

-- EtherNet/IP: items of the common packet format; 0x8002 has the connection, 0x00B1 its data.
local function ethernet_ip(tvb, pinfo, tree, at, sender)
    local len, connection = tvb:len(), ""
    if len < at + 2 then return end
    local items = tvb(at, 2):le_uint()
    at = at + 2
    for _ = 1, math.min(items, 8) do
        if len < at + 4 then return end
        local kind, size = tvb(at, 2):le_uint(), tvb(at + 2, 2):le_uint()
        at = at + 4
        if len < at + size then return end
        if kind == 0x8002 and size >= 4 then connection = tvb(at, 4):le_uint() end
        if kind == 0x00B1 then
            show_all(tvb, pinfo, tree, "eip " .. sender .. connection, at, at + size, true)
        end
        at = at + size
    end
end

-- EtherCAT: datagrams. Inputs of a frame that no device has answered yet are those of an earlier cycle, and not shown.
local function ethercat(tvb, pinfo, tree, at)
    local len = tvb:len()
    if len < at + 2 or math.floor(tvb(at, 2):le_uint() / 4096) ~= 1 then return end
    local until_ = math.min(len, at + 2 + tvb(at, 2):le_uint() % 2048)
    at = at + 2
    while at + 12 <= until_ do
        local command, address = tvb(at, 1):uint(), tvb(at + 2, 4):le_uint()
        local size = tvb(at + 6, 2):le_uint()
        local has_next = math.floor(size / 32768) == 1
        size = size % 2048
        if at + 12 + size > len then return end
        local working_counter = tvb(at + 10 + size, 2):le_uint()
        if command >= 10 and command <= 12 then
            show_all(tvb, pinfo, tree, "ecat " .. command .. " " .. address, at + 10, at + 10 + size, true,
                function(kind) return working_counter > 0 or kind.name == "Command" end)
        end
        if not has_next then return end
        at = at + 12 + size
    end
end

local ethernet = Field.new("eth.type")
local ETHER_TYPES = { [0x8892] = true, [0x0800] = true, [0x88A4] = true }

function image.dissector(tvb, pinfo, tree)
    if not ethernet() or tvb:len() < 16 then return end
    local at = 12
    while tvb(at, 2):uint() == 0x8100 and tvb:len() >= at + 6 do
        at = at + 4
    end
    local kind = tvb(at, 2):uint()
    if not ETHER_TYPES[kind] then return end
    at = at + 2
    local sender = tostring(pinfo.src) .. " "
    if kind == 0x8892 then
        profinet(tvb, pinfo, tree, at, sender)
    elseif kind == 0x88A4 then
        ethercat(tvb, pinfo, tree, at)
    elseif tvb:len() >= at + 28 and tvb(at + 9, 1):uint() == 17 then
        -- Whole datagrams of UDP only.
        local udp = at + 4 * (tvb(at, 1):uint() % 16)
        if tvb(at + 6, 2):uint() % 16384 ~= 0 or tvb:len() < udp + 8 then return end
        local from, to = tvb(udp, 2):uint(), tvb(udp + 2, 2):uint()
        if to == 34962 or from == 34962 then
            profinet(tvb, pinfo, tree, udp + 8, sender)
        elseif to == 2222 or from == 2222 then
            ethernet_ip(tvb, pinfo, tree, udp + 8, sender)
        elseif to == 34980 then
            ethercat(tvb, pinfo, tree, udp + 8)
        end
    end
end

register_postdissector(image)
