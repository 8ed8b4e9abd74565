"""What is written into files that are there, for each part: (file, before which text, what)."""

VERB = [
    (
        "rig/protocol/steps.py",
        "@dataclass(frozen=True, kw_only=True)\nclass Touch(",
        '''\
@dataclass(frozen=True, kw_only=True)
class Tap(Step[ExpectedTouch, None]):
    """Touch the present place so many times, to tell a subject that presses follow."""

    verb: ClassVar[str] = "tap"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST

    times: int

    def check(self, state: ScriptState) -> PressPlace:
        state.need_ready(self.verb)
        refuse_count(self.verb, "times", self.times)
        return state.place("find", self.times)

    def expect(self, place: PressPlace, state: ScriptState) -> ExpectedTouch:
        contact_mm = state.model.touch_height_mm(place.indentor, place.x_mm, place.along_mm)
        refuse_approach(self.verb, contact_mm, state.settings)
        return ExpectedTouch(place.ids[0], contact_mm)

    def execute(self, engine: Engine, expected: ExpectedTouch) -> None:
        first, times = expected.press.index, self.times
        found = [indentation.touch_place(engine, first + k, expected.contact_mm) for k in range(times)]
        engine.record(events.TapEvent(times, engine.x_mm, sum(found) / times))


''',
    ),
    ("rig/protocol/steps.py", "from rig.engine import", "from rig.data import events\n"),
    ("rig/protocol/api.py", "    touch = ", "    tap = _method(steps.Tap)\n"),
    (
        "rig/data/events.py",
        "@dataclass(frozen=True, eq=False, repr=False)\nclass CheckpointEvent(Event):",
        '''\
@dataclass(frozen=True, eq=False, repr=False)
class TapEvent(Event):
    """Contact was found several times."""

    times: Annotated[int, "number of touches"]
    x_mm: Across
    contact_height_mm: ContactHeight


''',
    ),
]

STAGE = [("rig/devices/registry.py", '"leadshine", ', '"hobby", ')]

FORCE = [("rig/devices/registry.py", '"laumas", ', '"plain", ')]

SHAPE = [
    (
        "sim/contact/profiles.py",
        "def _floored(",
        '''\
@dataclass(frozen=True)
class Parabola(IndentorProfile):
    """Ridge with a parabola for its section."""

    radius_mm: float

    @property
    def name(self) -> str:
        """The shape as it is written on the command line."""
        return f"parabola:{self.radius_mm:g}"

    @property
    def sharpest_radius_mm(self) -> float:
        """At the tip."""
        return self.radius_mm

    def evaluate(self, s_mm: Array) -> tuple[Array, Array, Array]:
        """Height, slope and curvature: h = s² / 2R."""
        slope = s_mm / self.radius_mm
        return 0.5 * slope * s_mm, slope, np.full_like(s_mm, 1 / self.radius_mm)


''',
    ),
    ("sim/contact/shapes.py", "SinusoidalStep, Wedge\n", "Parabola, "),
    ("sim/contact/shapes.py", "sphere:RADIUS, flat", "parabola:RADIUS, "),
    (
        "sim/contact/shapes.py",
        "def _sphere(",
        "def _parabola(text: str, argument: str) -> Indentor:\n"
        '    return Indentor.along(Parabola(_number(text, argument, "radius", "mm", 0.25, 25.0)))\n\n\n',
    ),
    ("sim/contact/shapes.py", '    "sphere": _sphere', '    "parabola": _parabola,\n'),
]

MEASURE = [
    (
        "sim/measures/measures.py",
        '    Measure("s11"',
        '    Measure("gmax", STRAIN, "largest shear strain, ep3 − ep1",\n'
        "            lambda at: at.principal_strain[..., 2] - at.principal_strain[..., 0]),\n",
    ),
]

MODEL = [
    ("sim/models/catalogue.py", "from sim.models.finger_3d import", "from sim.models.soft import build_soft\n"),
    ("sim/models/catalogue.py", '"finger"]\n', '"soft", '),
    ("sim/models/catalogue.py", '    "finger": build_finger', '    "soft": build_soft,\n'),
]

COMMAND = [
    (
        "rig/cli/program.py",
        '    "find": ',
        '    "holds": Command("holds.command", "Say what force was held at each hold of a run.", "Results"),\n',
    )
]

RUN_SECTION = [
    (
        "rig/report/run_figures.py",
        "def population_responses(",
        '''\
def final_depths(found: list[PredictedHold]) -> Plot:
    """Plot the depth of each hold against the indentor's place."""
    x, depth = ([response.hold[key] for response in found] for key in ("x_mm", "doi_mm"))
    rows = rows_of("hold_end.csv", "x_mm", "doi_mm")
    points = Series("plot", x, depth, rows=rows, ls="", marker=".", color=GREY)
    return Plot((6.6, 2.6), [Subplot("indentor x (mm)", "depth (mm)", [points])], "Final depths", "Every hold.")


''',
    ),
    (
        "rig/report/run_report.py",
        "        *_population_figures(found),\n",
        "        run_figures.final_depths(found),\n",
    ),
]

COMPARISON_SECTION = [
    (
        "rig/report/profile_figures.py",
        "def populations(",
        '''\
def depths(stimulus: StimulusRow) -> Plot:
    """Plot the depth at each position."""
    rows = rows_of("population", "x_mm", "doi_mm", stimulus=stimulus)
    line = Series("plot", stimulus.x_mm, stimulus.doi_mm, rows=rows, marker="o", ms=2, lw=1, color=GREY)
    panel = Subplot("indentor x (mm)", "depth (mm)", [line])
    return Plot((4.6, 2.6), [panel], f"Depths: {stimulus.title}", "As held.")


''',
    ),
    (
        "rig/report/comparison_report.py",
        "        *figures_of(_moved(comparison), ",
        "        *map(profile_figures.depths, _moved(comparison)),\n",
    ),
]
