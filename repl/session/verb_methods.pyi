"""The verbs of a session as methods. Made by docs.generators.verb_methods; do not edit."""

from ergon.repl.session_protocol import Reply

class VerbMethods:
    """A method for each verb of `ergon repl`, which submits its line."""

    def back(self, *in_order: object, at: object = ..., count: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """back N"""

    def couple(self, *in_order: object, K: object = ..., Z: object = ..., a: object = ..., at: object = ..., b: object = ..., in_: object = ..., now: object = ..., stiffness: object = ..., sync: object = ..., viscosity: object = ...) -> Reply:
        """couple KEY KEY [K=STIFFNESS] [Z=VISCOSITY]"""

    def damp(self, *in_order: object, at: object = ..., in_: object = ..., now: object = ..., sync: object = ..., time: object = ...) -> Reply:
        """damp TIME"""

    def define(self, *in_order: object, at: object = ..., base: object = ..., fields: object = ..., in_: object = ..., name: object = ..., notation: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """NAME = "RHYTHM" [LEVEL …] [to INSTRUMENT] [cycle LENGTH] [do …] …
        NAME = NOTATION
        NAME = INSTRUMENT|FILE/NAME [transpose Nst] [FIELD=VALUE …]"""

    def define_block(self, *in_order: object, lines: object = ..., name: object = ...) -> Reply:
        """def NAME [NAME=VALUE …]: LINE …"""

    def do(self, *in_order: object, at: object = ..., do: object = ..., in_: object = ..., name: object = ..., now: object = ..., player: object = ..., sync: object = ...) -> Reply:
        """PLAYER do TRANSFORMATION, …
        NAME do TRANSFORMATION, …|none"""

    def every(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ..., trigger: object = ...) -> Reply:
        """NAME every LENGTH"""

    def fade(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., over: object = ..., sync: object = ..., way: object = ...) -> Reply:
        """fade INSTRUMENT|master in|out over LENGTH"""

    def filter(self, *in_order: object, at: object = ..., fields: object = ..., in_: object = ..., kind: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """filter INSTRUMENT lowpass|highpass|lowshelf|highshelf|delay VALUE [LEVEL]|off"""

    def gain(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., ratio: object = ..., sync: object = ...) -> Reply:
        """gain [NAME] LEVEL|xFACTOR
        gain STRIKES LEVEL|xFACTOR"""

    def gestures(self) -> Reply:
        """gestures"""

    def guide(self, *in_order: object, K: object = ..., Z: object = ..., at: object = ..., by: object = ..., in_: object = ..., now: object = ..., off: object = ..., player: object = ..., stiffness: object = ..., sync: object = ..., viscosity: object = ...) -> Reply:
        """guide PLAYER PLAYER [K=STIFFNESS] [Z=VISCOSITY]
        guide PLAYER off"""

    def hear(self, *in_order: object, stroke: object = ...) -> Reply:
        """hear INSTRUMENT[.ACT]|MODULE [NOTE …] [LEVEL]"""

    def help(self, *in_order: object, verb: object = ...) -> Reply:
        """help [VERB]"""

    def history(self) -> Reply:
        """history"""

    def hush(self, *, at: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """hush"""

    def instruments(self, *in_order: object, family: object = ...) -> Reply:
        """instruments [FAMILY]"""

    def keep(self, *in_order: object, as_: object = ..., length: object = ..., name: object = ...) -> Reply:
        """keep LENGTH as NAME"""

    def lfo(self, *in_order: object, at: object = ..., fields: object = ..., in_: object = ..., now: object = ..., off: object = ..., sync: object = ..., target: object = ...) -> Reply:
        """lfo PATH LOW..HIGH period LENGTH [shape SHAPE] …
        lfo PATH off"""

    def link(self, *in_order: object, a: object = ..., at: object = ..., b: object = ..., fields: object = ..., in_: object = ..., kind: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """link MODULE MODULE KIND FIELD=VALUE …"""

    def load(self, *in_order: object, at: object = ..., file: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """load FILE"""

    def look(self, *in_order: object, name: object = ...) -> Reply:
        """? [NAME]"""

    def map(self, *in_order: object, at: object = ..., bend: object = ..., cc: object = ..., curve: object = ..., gain: object = ..., gesture: object = ..., impulse: object = ..., in_: object = ..., learn: object = ..., note: object = ..., notes: object = ..., now: object = ..., player: object = ..., pressure: object = ..., range: object = ..., sounding: object = ..., source: object = ..., sync: object = ..., target: object = ..., tempo: object = ...) -> Reply:
        """map cc N|bend|pressure [NOTE]|learn PATH VALUE..VALUE
        map cc N|bend|pressure [NOTE]|learn gain NAME LEVEL..LEVEL
        map cc N|bend|pressure [NOTE]|learn gain LEVEL..LEVEL
        map cc N|bend|pressure [NOTE]|learn tempo BPM..BPM
        map note NOTE|NOTE..NOTE PLAYER GESTURE
        map note NOTE|NOTE..NOTE MODULE IMPULSE..IMPULSE [curve square|root|even]
        map note NOTE|NOTE..NOTE INSTRUMENT|BLOCK [curve square|root|even]
        map learn note INSTRUMENT|BLOCK"""

    def maps(self) -> Reply:
        """maps"""

    def meter(self, *in_order: object, at: object = ..., in_: object = ..., meter: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """meter BEATS/UNIT"""

    def meters(self) -> Reply:
        """meters"""

    def monitor(self, *in_order: object, off: object = ..., on: object = ...) -> Reply:
        """monitor on
        monitor off"""

    def mute(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """mute NAME
        mute STRIKES"""

    def notes(self, *in_order: object, at: object = ..., fields: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """INSTRUMENT notes NOTE … [every LENGTH] [euclid N N] [impulse …] [chance P] [do …] …"""

    def nudge(self, *in_order: object, by: object = ...) -> Reply:
        """nudge TIME"""

    def pan(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., over: object = ..., pan: object = ..., sync: object = ...) -> Reply:
        """pan INSTRUMENT PLACE
        pan INSTRUMENT PLACE over LENGTH"""

    def panic(self) -> Reply:
        """panic"""

    def phrase(self, *in_order: object, at: object = ..., entries: object = ..., in_: object = ..., length: object = ..., name: object = ..., now: object = ..., sync: object = ..., to: object = ...) -> Reply:
        """phrase NAME TIME NOTE … [IMPULSE], … [to INSTRUMENT] [length LENGTH]"""

    def play(self, *in_order: object, from_: object = ..., start: object = ...) -> Reply:
        """play [from WHERE]"""

    def plays(self, *in_order: object, **named: object) -> Reply:
        """PLAYER plays NAME … [from TIME] [every LENGTH] [times N] [until WHERE] [chance P] [do …] [touch …]"""

    def py(self, *in_order: object, expression: object = ...) -> Reply:
        """py EXPRESSION"""

    def quant(self, *in_order: object, grid: object = ...) -> Reply:
        """quant now|beat|bar|LENGTH"""

    def quit(self) -> Reply:
        """quit"""

    def record(self, *in_order: object, as_: object = ..., at: object = ..., audio: object = ..., file: object = ..., in_: object = ..., now: object = ..., off: object = ..., player: object = ..., sync: object = ..., take: object = ...) -> Reply:
        """record PLAYER as NAME
        record off
        record audio off
        record audio FILE"""

    def redo(self, *, at: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """redo"""

    def release(self) -> Reply:
        """release"""

    def reload(self, *, at: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """reload"""

    def remove(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """remove NAME"""

    def rename(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., old: object = ..., sync: object = ...) -> Reply:
        """rename NAME NAME"""

    def rest(self, *in_order: object, at: object = ..., in_: object = ..., now: object = ..., player: object = ..., sync: object = ...) -> Reply:
        """rest PLAYER|all"""

    def room(self, *in_order: object, at: object = ..., fields: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """room NAME FIELD=VALUE …"""

    def route(self, *in_order: object, at: object = ..., channels: object = ..., gain: object = ..., in_: object = ..., name: object = ..., now: object = ..., pan: object = ..., send: object = ..., sync: object = ...) -> Reply:
        """route INSTRUMENT CHANNEL …|nearest [gain LEVEL] [pan PLACE]
        route INSTRUMENT gain LEVEL
        route INSTRUMENT pan PLACE
        route INSTRUMENT send ROOM LEVEL"""

    def run(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ..., values: object = ...) -> Reply:
        """run NAME [VALUE|NAME=VALUE …]"""

    def save(self, *in_order: object, file: object = ...) -> Reply:
        """save [FILE]"""

    def scene(self, *in_order: object, at: object = ..., in_: object = ..., names: object = ..., now: object = ..., over: object = ..., sync: object = ...) -> Reply:
        """scene NAME|NAME -> NAME [over LENGTH]"""

    def scenes(self) -> Reply:
        """scenes"""

    def scope(self, *in_order: object, name: object = ..., off: object = ..., on: object = ...) -> Reply:
        """scope NAME
        scope NAME on
        scope off"""

    def seed(self, *in_order: object, at: object = ..., in_: object = ..., now: object = ..., seed: object = ..., sync: object = ...) -> Reply:
        """seed N"""

    def set(self, *in_order: object, at: object = ..., bend: object = ..., by: object = ..., cc: object = ..., change: object = ..., channel: object = ..., ends: object = ..., fields: object = ..., file: object = ..., from_: object = ..., in_: object = ..., now: object = ..., over: object = ..., pressure: object = ..., range: object = ..., source: object = ..., start: object = ..., sync: object = ..., target: object = ..., until: object = ...) -> Reply:
        """set PATH VALUE … every LENGTH …
        set PATH from FILE by cc N|bend|pressure [NOTE] range LOW..HIGH [channel N] [start QUARTERS] [until WHERE]
        set INSTRUMENT.tuning|tuning edo N|A4 HERTZ|scale FILE [keys FILE]|off … [over LENGTH]
        set PATH VALUE|xFACTOR [over LENGTH]"""

    def show(self, *in_order: object, name: object = ...) -> Reply:
        """show [NAME]"""

    def solo(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """solo NAME
        solo STRIKES"""

    def stop(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """stop
        stop NAME"""

    def strikes(self, *in_order: object, at: object = ..., fields: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """NAME strikes MODULE … [every LENGTH] [impulse …] [chance P] [euclid N N] [do …] …
        NAME strikes PHRASE [every LENGTH] [times N] [transpose Nst] [do …]"""

    def takes(self, *in_order: object, at: object = ..., in_: object = ..., key: object = ..., like: object = ..., now: object = ..., player: object = ..., sync: object = ...) -> Reply:
        """NAME takes KEY [like KEY]"""

    def tap(self) -> Reply:
        """tap"""

    def tempo(self, *in_order: object, at: object = ..., bpm: object = ..., in_: object = ..., now: object = ..., over: object = ..., sync: object = ...) -> Reply:
        """tempo BPM|BPM -> BPM [over LENGTH]"""

    def uncouple(self, *in_order: object, a: object = ..., at: object = ..., b: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """uncouple KEY KEY"""

    def undo(self, *, at: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """undo"""

    def unmap(self, *in_order: object, at: object = ..., bend: object = ..., cc: object = ..., in_: object = ..., learn: object = ..., note: object = ..., notes: object = ..., now: object = ..., pressure: object = ..., source: object = ..., sync: object = ...) -> Reply:
        """unmap cc N|bend|pressure [NOTE]|learn
        unmap note NOTE|NOTE..NOTE"""

    def unmute(self, *in_order: object, at: object = ..., in_: object = ..., name: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """unmute [NAME]
        unmute STRIKES"""

    def use(self, *in_order: object, at: object = ..., family: object = ..., in_: object = ..., now: object = ..., sync: object = ...) -> Reply:
        """use FAMILY|FILE"""

    def voices(self) -> Reply:
        """voices"""

    def when(self, *in_order: object, at: object = ..., in_: object = ..., now: object = ..., rule: object = ..., sync: object = ...) -> Reply:
        """when CONDITION NAME"""
