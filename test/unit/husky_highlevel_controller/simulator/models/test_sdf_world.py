"""World files: what is read, what is named in a warning, what is refused."""

import logging
import re
from math import pi
from pathlib import Path
from xml.etree import ElementTree

import pytest

from husky_highlevel_controller.datatypes import (
    Box,
    Cylinder,
    HuskyError,
    Plane,
    Sphere,
)
from husky_highlevel_controller.geometry import compose, quat_from_rpy, transform_point, yaw_from_quat
from husky_highlevel_controller.simulator.models.sdf_world import WorldError, load_world, parse_world

ROOT = Path(__file__).resolve().parents[5]
DATA = ROOT / "test" / "data"
EVERYTHING = (DATA / "everything.world").read_text()


def bodies_of(world):
    return {body.name: body for body in world.bodies}


def sdf(*inside, version="1.6"):
    return f'<sdf version="{version}"><world name="w">{"".join(inside)}</world></sdf>'


def model(*inside, name="m"):
    return f'<model name="{name}"><link name="link">{"".join(inside)}</link></model>'


def solid(geometry, pose=""):
    return model(f'<collision name="c"><pose>{pose}</pose><geometry>{geometry}</geometry></collision>')


def saved(inside):
    """A box, and where a saved world says it is."""
    box = solid("<box><size>1 1 1</size></box>")
    return box + f'<state world_name="w"><model name="m">{inside}</model></state>'


def include(name, *inside):
    return f"<include><uri>model://{name}</uri>{''.join(inside)}</include>"


def only_thing(*inside, **attributes):
    (body,) = parse_world(sdf(*inside, **attributes), "test.world").bodies
    return body


def refusal(text):
    with pytest.raises(WorldError) as caught:
        parse_world(text, "test.world")
    return str(caught.value)


@pytest.fixture(autouse=True)
def no_models(monkeypatch):
    monkeypatch.delenv("GAZEBO_MODEL_PATH", raising=False)


# ---------------------------------------------------------------------------- our own worlds


GROUND = ("ground_plane", (0.0, 0.0, 0.0), 0.0, Plane((0.0, 0.0, 1.0), (100.0, 100.0)))
PILLAR = ("unit_cylinder", (20.0, 5.0, 0.5), 1.0, Cylinder(radius=0.2, length=2.0))
SECOND = ("unit_cylinder_0", (20.0, 8.0, 0.5), *PILLAR[2:])


@pytest.mark.parametrize(
    ("name", "things"),
    [("empty", [GROUND]), ("singlePillar", [GROUND, PILLAR]), ("driveThrough", [GROUND, PILLAR, SECOND])],
)
def test_the_course_s_worlds_are_a_static_ground_and_pillars_of_1_kg(name, things):
    bodies = load_world(ROOT / "worlds" / f"{name}.world").bodies
    for look in ("collisions", "visuals"):
        read = [(b.name, b.pose_in_world.position, b.mass, getattr(b, look)[0].shape) for b in bodies]
        assert read == things


@pytest.mark.parametrize("path", sorted((ROOT / "worlds").glob("*.world")), ids=lambda path: path.name)
def test_our_worlds_need_no_warning_and_say_what_they_are(path, caplog):
    load_world(path)
    assert not caplog.records
    assert re.match(r"<\?xml [^>]*\?>\s*<!--", path.read_text())


# ---------------------------------------------------------------------------- what is read


def test_poses_of_model_link_and_part_add_up():
    world = load_world(DATA / "everything.world")
    assert (world.name, world.gravity) == ("everything", (0.0, 0.0, -1.62))
    bodies = bodies_of(world)
    assert list(bodies) == ["floor", "tower::foot", "tower::lamp", "tower::flag"]
    foot = bodies["tower::foot"]
    # the tower is turned to the left, so its forward is the world's y
    assert foot.pose_in_world.position == pytest.approx((10.0, 1.0, 0.5))
    assert yaw_from_quat(foot.pose_in_world.quat_xyzw) == pytest.approx(pi / 2)
    box = compose(foot.pose_in_world, foot.collisions[0].pose_in_body)
    assert box.position == pytest.approx((10.0, 1.5, 0.5))
    assert foot.collisions[0].pose_in_body.quat_xyzw == pytest.approx(quat_from_rpy(0.1, 0.2, 0.3))
    assert bodies["tower::flag"].pose_in_world.position == pytest.approx((10.0, 2.0, 0.0))
    assert bodies["floor"].pose_in_world.position == (0.0, 0.0, -1.0)


def test_shapes_masses_and_colours_are_read():
    bodies = bodies_of(load_world(DATA / "everything.world"))
    foot, lamp, flag = bodies["tower::foot"], bodies["tower::lamp"], bodies["tower::flag"]
    assert foot.collisions[0].shape == Box((1.0, 2.0, 3.0))
    assert foot.visuals[0].shape == Sphere(0.5)
    assert [part.shape for part in lamp.visuals] == [Cylinder(0.1, 4.0)]
    assert lamp.collisions == (), "it is only drawn"
    assert flag.collisions[0].shape == Plane((0.0, 0.0, -1.0), (7.0, 8.0))
    assert (foot.mass, lamp.mass) == (2.5, 1.0)  # a link that says nothing weighs 1 kg
    assert flag.mass == 0.0  # static, whatever it weighs
    assert foot.visuals[0].rgba == (0.1, 0.2, 0.3, 0.25)  # diffuse before ambient, three quarters transparent
    assert lamp.visuals[0].rgba == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(("text", "mass"), [("1", 0.0), ("true", 0.0), ("0", 1.0), ("false", 1.0)])
def test_static_is_said_in_four_ways_and_fixes_the_models_in_it(text, mass):
    outer = f'<model name="outer"><static>{text}</static><link name="link"/>{model(name="inner")}</model>'
    bodies = parse_world(sdf(outer), "test.world").bodies
    assert [(body.name, body.mass) for body in bodies] == [("outer", mass), ("outer::inner", mass)]


@pytest.mark.parametrize(
    ("version", "inside", "gravity"),
    [
        ("1.4", "<physics type='ode'><gravity>0 0 -3.7</gravity></physics>", -3.7),
        *[(version, "", -9.8) for version in ("1.4", "1.5", "1.6", "1.7")],
    ],
)
def test_gravity_stands_in_physics_in_sdf_1_4_and_is_the_earths_when_nothing_is_said(
    version, inside, gravity
):
    assert parse_world(sdf(inside, version=version), "test.world").gravity == (0.0, 0.0, gravity)


@pytest.mark.parametrize(
    ("material", "rgba"),
    [
        ("<ambient>0.1 0.2 0.3 0.4</ambient>", (0.1, 0.2, 0.3, 0.4)),
        ("<diffuse>0.1 0.2 0.3</diffuse>", (0.1, 0.2, 0.3, 1.0)),
        ("<diffuse>255 51 0 1</diffuse>", (1.0, 0.2, 0.0, 1.0)),
        ("<script><name>Gazebo/Blue</name></script>", (0.0, 0.0, 1.0, 1.0)),
        ("<script><name>Gazebo/Blue</name></script><diffuse>1 0 0 1</diffuse>", (1.0, 0.0, 0.0, 1.0)),
        ("", (0.7, 0.7, 0.7, 1.0)),
    ],
)
def test_colours_come_from_numbers_or_gazebos_names(material, rgba):
    ball = "<geometry><sphere><radius>1</radius></sphere></geometry>"
    body = only_thing(model(f'<visual name="v">{ball}<material>{material}</material></visual>'))
    assert body.visuals[0].rgba == pytest.approx(rgba)


def test_poses_are_relative_to_the_frame_they_name(caplog):
    bodies = bodies_of(load_world(DATA / "frames.world"))
    post = bodies["post"]
    assert post.pose_in_world.position == (5.0, 0.0, 3.0)
    assert len(post.collisions) == 4
    for part in post.collisions:
        centre = transform_point(post.pose_in_world, part.pose_in_body.position)
        assert centre == pytest.approx((5.0, 0.0, 1.0))
    for name in ("box", "gate"):  # relative to a frame at a link of a later model, and to an earlier model
        assert bodies[name].pose_in_world.position == pytest.approx((6.0, 1.0, 1.0)), name
        assert yaw_from_quat(bodies[name].pose_in_world.quat_xyzw) == pytest.approx(0.0)
    assert not caplog.records


def posed_model(name, relative_to, *inside):
    pose = f'<pose relative_to="{relative_to}">1 0 0 0 0 0</pose><link name="{name}"/>'
    return f'<model name="{name}">{pose}{"".join(inside)}</model>'


def frame(name, attached_to):
    return f'<frame name="{name}" attached_to="{attached_to}"/>'


# ---------------------------------------------------------------------------- worlds that Gazebo saved


def test_a_saved_world_opens_as_it_was_saved(caplog):
    bodies = bodies_of(load_world(DATA / "saved.world"))
    positions = {name: body.pose_in_world.position for name, body in bodies.items()}
    assert {name: pytest.approx(position) for name, position in positions.items()} == {
        "ground_plane": (0.0, 0.0, 0.0),
        "post": (6.0, 1.0, 1.0),
        "wall": (-8.0, 0.0, 0.5),
        "cart::body": (10.0, 0.0, 1.0),  # not in the state: it goes along with its model
        "cart::wheel": (10.0, 5.0, 0.0),  # a pose in the state is in the world
        "cart::flag": (10.0, 0.0, 7.0),
        "cart::lamp": (10.0, 0.0, 3.0),
        "late": (4.0, 4.0, 1.0),
    }
    yaws = {name: yaw_from_quat(body.pose_in_world.quat_xyzw) for name, body in bodies.items()}
    assert yaws["cart::body"] == yaws["cart::lamp"] == pytest.approx(pi / 2)
    assert yaws["cart::wheel"] == yaws["cart::flag"] == 0.0
    assert bodies["post"].collisions[0].shape == Cylinder(0.2, 2.0)
    assert bodies["wall"].collisions[0].shape == Box((0.2, 6.0, 1.0))
    assert bodies["late"].visuals[0].shape == Sphere(1.5)
    (message,) = caplog.messages
    assert "a <model> of the robot is left out" in message


@pytest.mark.parametrize(
    ("shape", "scaled"),
    [
        ("<box><size>1 2 3</size></box>", Box((2.0, 10.0, 12.0))),
        ("<cylinder><radius>1</radius><length>2</length></cylinder>", Cylinder(5.0, 8.0)),
        ("<sphere><radius>1</radius></sphere>", Sphere(5.0)),
    ],
)
def test_shapes_of_a_saved_model_are_scaled(shape, scaled):
    state = '<state><model name="m"><pose>0 0 0 0 0 0</pose><scale>2 5 4</scale></model></state>'
    geometry = f"<geometry>{shape}</geometry>"
    parts = (f'<{tag} name="p">{geometry}</{tag}>' for tag in ("collision", "visual"))
    body = only_thing(model(*parts), state)
    assert [part.shape for part in (*body.collisions, *body.visuals)] == [scaled, scaled]


# ---------------------------------------------------------------------------- includes


def make_model(folder, name, text, file="model.sdf"):
    (folder / name).mkdir(exist_ok=True)
    (folder / name / file).write_text(text)


BALL = '<sdf version="1.5"><model name="ball"><pose>1 1 1 0 0 0</pose>{}</model></sdf>'.format(
    '<link name="l"><collision name="c"><geometry><sphere><radius>{radius}</radius></sphere></geometry>'
    "</collision></link>"
)


@pytest.fixture
def models(tmp_path, monkeypatch):
    """A model folder with a ball and a lamp; the path also names a folder that is not there, as paths do."""
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"{tmp_path / 'missing'}:{tmp_path}")
    make_model(tmp_path, "ball", BALL.format(radius=0.1))
    make_model(tmp_path, "lamp", '<sdf version="1.5"><light name="lamp" type="point"/></sdf>')
    return tmp_path


@pytest.mark.usefixtures("models")
@pytest.mark.parametrize(
    ("inside", "things"),
    [
        (include("ball"), [("ball", (1.0, 1.0, 1.0), 1.0)]),
        (
            include("ball", "<name>football</name><pose>4 0 0 0 0 0</pose><static>true</static>"),
            [("football", (4.0, 0.0, 0.0), 0.0)],
        ),
        (
            f'<model name="car"><pose>0 0 5 0 0 0</pose>{include("ball", "<name>wheel</name>")}</model>',
            [("car::wheel", (1.0, 1.0, 6.0), 1.0)],
        ),
        # the course's football world has its two goals like this
        (include("ball") * 3, [(name, (1.0, 1.0, 1.0), 1.0) for name in ("ball", "ball_1", "ball_2")]),
        (include("lamp"), []),
    ],
    ids=["where the model says", "where the include says", "in a model", "nameless ones numbered", "a lamp"],
)
def test_an_included_model_is_found_named_and_placed(inside, things, caplog):
    bodies = parse_world(sdf(inside), "test.world").bodies
    assert [(body.name, body.pose_in_world.position, body.mass) for body in bodies] == things
    assert not caplog.records


@pytest.mark.parametrize(
    ("offers", "radius", "warning"),
    [
        (["1.4", "1.6", "1.9"], 1.6, None),
        (["1.3"], 1.3, "SDF 1.3 is read as SDF 1.4"),
        (["1.9"], 1.9, "SDF is read as SDF 1.7"),
    ],
)
def test_the_newest_readable_file_of_a_model_is_taken_or_another_with_a_warning(
    offers, radius, warning, models, caplog
):
    lines = "".join(f'<sdf version="{version}">{version}.sdf</sdf>' for version in offers)
    make_model(models, "ball", f"<model><name>ball</name>{lines}</model>", "model.config")
    for version in offers:
        make_model(models, "ball", BALL.format(radius=version).replace("1.5", version), f"{version}.sdf")
    assert only_thing(include("ball")).collisions[0].shape == Sphere(radius)
    assert [warning in message for message in caplog.messages] == ([True] if warning else [])


@pytest.mark.parametrize("server", ["fuel.gazebosim.org", "fuel.ignitionrobotics.org"])
@pytest.mark.parametrize("name", ["Ground Plane", "Ground%20Plane/2", "ground plane/tip/files/model.sdf"])
def test_fuels_ground_and_sun_are_known_without_a_network(server, name, caplog):
    folder = f"https://{server}/1.0/OpenRobotics/models"
    includes = [f"<include><uri>{folder}/{each}</uri></include>" for each in ("Sun", name)]
    (ground,) = parse_world(sdf(*includes), "test.world").bodies
    assert ground == load_world(ROOT / "worlds" / "empty.world").bodies[0]
    assert not caplog.records


def test_a_model_that_cannot_be_read_is_refused_by_its_file(models):
    make_model(models, "egg", f'<sdf version="1.5"><model name="egg">{include("hen")}</model></sdf>')
    make_model(models, "hen", f'<sdf version="1.5"><model name="hen">{include("egg")}</model></sdf>')
    make_model(models, "old", '<model><sdf version="1.2">model.sdf</sdf></model>', "model.config")
    make_model(models, "ball", BALL.format(radius=-1))
    for name, words in (
        ("egg", r"hen/model\.sdf:1.*includes itself.*egg.*hen.*egg"),
        ("old", r"model\.config.*'1\.2' is not supported; 1\.3 to 1\.12"),
        ("ball", rf"^{models}/ball/model\.sdf.*'-1'"),
    ):
        assert re.search(words, refusal(sdf(include(name)))), name


# ---------------------------------------------------------------------------- what is named in a warning


def test_what_is_not_supported_is_named_once_per_kind(caplog):
    world = load_world(DATA / "unsupported.world")
    assert [body.name for body in world.bodies] == ["house", "hill"]
    walls = bodies_of(world)["house"]
    assert walls.collisions == ()
    assert [part.shape for part in walls.visuals] == [Box((1.0, 0.1, 2.0))]
    kinds = ["a mesh is not on this machine", "<heightmap>", "<sensor>", "<plugin>", "<actor>", "<kinematic>"]
    kinds += ["<gravity>", "<model>", "<include>", "<inertial>", "material"]
    for kind in kinds:
        assert sum(kind in message.split(": ")[0] for message in caplog.messages) == 1, kind
    assert "no shape of its 3 models is left" in caplog.messages[-1]
    assert len(caplog.messages) == len(kinds) + 1
    assert {record.levelno for record in caplog.records} == {logging.WARNING}
    (mesh,) = (message for message in caplog.messages if "mesh is" in message)
    for place in ("unsupported.world:", "model 'house' > link 'walls' > collision 'walls'", "visual 'walls'"):
        assert place in mesh


FAR = "https://models.example/"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        # values that differ are one kind
        (sdf(*(f"<include><uri>{FAR}{each}</uri></include>" for each in "ab")), [f"{FAR}a", f"{FAR}b"]),
        (sdf('<plugin name="p" filename="f"/>' * 10), ["and 7 more"]),
        ('<sdf version="1.4"><world name="w"/><world name="b"/></sdf>', ["only the first <world>"]),
        (sdf(model("<colision/>")), ["<colision>", "model 'm' > link 'link'"]),
        (sdf("<wind/>"), []),
        (sdf("<wind><linear_velocity>1 0 0</linear_velocity></wind>"), ["<wind>"]),
        (
            sdf(model('<pose relative_to="elsewhere">0 0 9 0 0 0</pose>'), version="1.7"),
            ["read relative to the parent", "model 'm' > link 'link' > pose 'elsewhere'"],
        ),
        (sdf(version="1.3"), ["is read as SDF 1.4: test.world:1"]),
        (sdf(version="1.12"), ["is read as SDF 1.7: test.world:1"]),
    ],
)
def test_what_is_left_out_is_named_in_one_warning(text, words, caplog):
    world = parse_world(text, "test.world")
    assert (world.name, len(caplog.messages)) == ("w", bool(words))
    assert all(each in caplog.text for each in words)
    assert not world.bodies or world.bodies[0].pose_in_world.position in ((0.0, 0.0, 0.0), (0.0, 0.0, 9.0))


def test_a_second_model_of_one_name_is_left_out_as_in_gazebo(caplog):
    posts = [posed_model("post", "world"), model(name="post"), model(name="other")]
    bodies = parse_world(sdf(*posts), "test.world").bodies
    assert [(body.name, body.pose_in_world.position[0]) for body in bodies] == [("post", 1.0), ("other", 0.0)]
    (message,) = caplog.messages
    assert (
        message
        == "a second model of the same name is left out, as in Gazebo: test.world:1: model 'post' 'post'"
    )


# ---------------------------------------------------------------------------- what is left out, and named


BOX = "<geometry><box><size>1 1 1</size></box></geometry>"
COLLISION, VISUAL = f'<collision name="c">{BOX}</collision>', f'<visual name="v">{BOX}{{}}</visual>'
CUBE = ("m", (0.0, 0.0, 0.0), 1.0, 1, 0)  # name, position, mass, how many collisions and visuals


def cube(*inside, shapes=COLLISION):
    return model(shapes, *inside)


def visual(inside):
    return cube(VISUAL.format(inside))


def inertial(inside):
    return cube(f"<inertial>{inside}</inertial>")


def placed(text, position):
    return cube(f"<pose>{text}</pose>"), "a <pose> needs 6 numbers", text, [("m", position, 1.0, 1, 0)]


def flagged(tag, text):
    return cube(f"<{tag}>{text}</{tag}>"), f"<{tag}>", text, [CUBE]


LEFT_OUT = [
    # what is said of masses
    (inertial("<inertia><ixx>nan</ixx></inertia>"), "an inertia that is not a number", "ixx", [CUBE]),
    (inertial("<pose>a b c 0 0 0</pose>"), "a centre of mass that cannot be read", "'a b c 0 0 0'", [CUBE]),
    (inertial("<mass>-1</mass>"), "is read as 1 kg", "mass: must be greater than zero, not '-1'", [CUBE]),
    (inertial("<mass>0</mass>"), "is read as 1 kg", "not '0'", [CUBE]),
    (inertial("<mass>much</mass>"), "is read as 1 kg", "not 'much'", [CUBE]),
    (inertial("<mass>1e9</mass>"), "a mass outside of 0.001 to 100000 kg", "1e+09", [(*CUBE[:2], 1e5, 1, 0)]),
    # what is only drawn
    (visual("<material><diffuse>red</diffuse></material>"), "a colour that", "'red'", [(*CUBE[:4], 1)]),
    (visual("<material><ambient>1</ambient></material>"), "a colour that", "not '1'", [(*CUBE[:4], 1)]),
    (visual("<transparency>glass</transparency>"), "a <transparency>", "'glass'", [(*CUBE[:4], 1)]),
    (visual("<pose>x</pose>"), "a <visual> that cannot be read", "'x'", [CUBE]),
    (
        cube('<visual name="v"><geometry><sphere><radius>-1</radius></sphere></geometry></visual>'),
        "a <visual> that cannot be read",
        "radius: must be greater than zero, not '-1'",
        [CUBE],
    ),
    (cube('<visual name="v"/>'), "a <visual> without a shape", "visual 'v'", [CUBE]),
    (
        solid("<plane><size>big</size></plane>").replace("<link", "<static>1</static><link"),
        "a <size> of a plane that cannot be read",
        "'big'",
        [("m", (0.0, 0.0, 0.0), 0.0, 1, 0)],
    ),
    # what has no shape
    (solid(""), "a <collision> without a shape", "collision 'c'", [(*CUBE[:3], 0, 0)]),
    (model('<collision name="c"/>'), "a <collision> without a shape", "collision 'c'", [(*CUBE[:3], 0, 0)]),
    # poses
    placed("1 2 3", (1.0, 2.0, 3.0)),
    placed("1", (1.0, 0.0, 0.0)),
    placed("1 2 3 0 0", (1.0, 2.0, 3.0)),
    placed("1 2 3 0 0 0 9", (1.0, 2.0, 3.0)),
    (saved("<pose>1 2</pose>"), "a <pose> needs 6 numbers", "state", [("m", (1.0, 2.0, 0.0), 1.0, 1, 0)]),
    (
        cube() + model(COLLISION, "<pose>0 0 -1.05e7 0 0 0</pose>", name="fallen"),
        "a link farther than 10000 m from the origin",
        "model 'fallen'",
        [CUBE],
    ),
    (
        cube(f'<collision name="d"><pose>0 2e4 0 0 0 0</pose>{BOX}</collision>'),
        "a shape farther than 10000 m from its link",
        "collision 'd'",
        [CUBE],
    ),
    # names
    (
        f'<model><link name="l">{COLLISION}</link></model>',
        "a <model> without",
        "model_at_line_1",
        [("model_at_line_1", *CUBE[1:])],
    ),
    (
        f'<model name="m"><link name="a">{COLLISION}</link><link name="a">{COLLISION}</link></model>',
        "a second <link> of the same name",
        "link 'a'",
        [("m::a", *CUBE[1:]), ("m::a_1", *CUBE[1:])],
    ),
    # includes
    ("<include/>" + cube(), "an <include> without a <uri>", "include", [CUBE]),
    (include("cathedral") + cube(), "a model that is not on this machine", "model://cathedral", [CUBE]),
    (include("sun", "<pose>up</pose>") + cube(), "a <pose> that cannot be read", "'up'", [CUBE]),
    # flags without effect
    flagged("gravity", "down"),
    flagged("kinematic", "perhaps"),
    flagged("self_collide", "rarely"),
    # planes that could fall
    (
        solid("<plane/>") + model(name="n"),
        "a <plane> cannot move",
        "'m'",
        [("m", (0.0, 0.0, 0.0), 0.0, 1, 0), ("n", (0.0, 0.0, 0.0), 1.0, 0, 0)],
    ),
]


@pytest.mark.parametrize(
    ("inside", "sentence", "value", "remain"), LEFT_OUT, ids=[f"{s}-{v}" for _, s, v, _ in LEFT_OUT]
)
def test_what_the_simulation_does_not_use_refuses_nothing_and_is_named(
    inside, sentence, value, remain, caplog
):
    bodies = parse_world(sdf(inside), "test.world").bodies
    things = [(b.name, b.pose_in_world.position, b.mass, len(b.collisions), len(b.visuals)) for b in bodies]
    assert things == remain
    (message,) = caplog.messages
    assert sentence in message
    assert "test.world:1" in message
    assert value in message


def test_a_model_config_that_cannot_be_read_leaves_the_plain_file(models):
    make_model(models, "ball", "<model", "model.config")
    assert only_thing(include("ball")).collisions[0].shape == Sphere(0.1)


def test_a_model_config_that_names_a_file_that_is_not_there_leaves_the_model_out(models, caplog):
    make_model(models, "ball", '<model><sdf version="1.5">gone.sdf</sdf></model>', "model.config")
    assert parse_world(sdf(include("ball")), "test.world").bodies == ()
    assert "not on this machine" in caplog.text


# ---------------------------------------------------------------------------- joints


def link(name, x, *inside):
    return f'<link name="{name}"><pose>{x} 0 0 0 0 0</pose>{COLLISION}{"".join(inside)}</link>'


def joint(parent, child, kind="fixed"):
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent>{parent}</parent><child>{child}</child></joint>'
    )


def assembled(*inside, name="m"):
    return f'<model name="{name}">{"".join(inside)}</model>'


WHEELED = (link("a", 0), link("b", 2), link("c", 5))


@pytest.mark.parametrize(
    ("inside", "bodies", "warned"),
    [
        ((joint("a", "b"), joint("b", "c")), [("m", (0.0, 2.0, 5.0), 3.0, "")], False),
        ((joint("a", "b", "revolute"), joint("b", "c")), [("m", (0.0, 2.0, 5.0), 3.0, "")], True),
        (
            (joint("a", "c", "prismatic"),),
            [("m::a", (0.0, 5.0), 2.0, "m"), ("m::b", (0.0,), 1.0, "m")],
            True,
        ),
        ((joint("world", "a"), joint("a", "b"), joint("b", "c")), [("m", (0.0, 2.0, 5.0), 0.0, "")], False),
        ((), [(f"m::{each}", (0.0,), 1.0, "m") for each in "abc"], False),
        (("<self_collide>1</self_collide>",), [(f"m::{each}", (0.0,), 1.0, "") for each in "abc"], False),
        (
            ("<static>1</static>", joint("a", "b", "revolute")),
            [(f"m::{e}", (0.0,), 0.0, "m") for e in "abc"],
            False,
        ),
        (
            ('<frame name="hub" attached_to="b"/>', joint("a", "hub"), joint("inner::l", "c")),
            [("m::a", (0.0, 2.0), 2.0, "m"), ("m::c", (0.0, -5.0), 2.0, "m")],
            False,
        ),
    ],
    ids=[
        "all",
        "a hinge",
        "two of three",
        "on the ground",
        "none",
        "self_collide",
        "static",
        "frames and models",
    ],
)
def test_links_that_joints_hold_together_are_one_body_and_pass_through_the_others(
    inside, bodies, warned, caplog
):
    inner = assembled(link("l", 0), name="inner") if "inner" in "".join(inside) else ""
    read = parse_world(sdf(assembled(*WHEELED, inner, *inside), version="1.7"), "test.world").bodies
    places = [tuple(part.pose_in_body.position[0] for part in body.collisions) for body in read]
    assert [(b.name, xs, b.mass, b.model) for b, xs in zip(read, places)] == bodies
    assert [("joints do not move" in message) for message in caplog.messages] == [True] * warned


@pytest.mark.parametrize(
    ("inside", "held_together"),
    [
        (('<frame name="hub"/>', joint("hub", "c")), "ac"),
        (('<frame name="hub" attached_to="__model__"/>', joint("hub", "c")), "ac"),
        (('<frame name="hub" attached_to="inner"/>', joint("hub", "c")), "lc"),
        ((joint("inner", "c"),), "lc"),
        ((joint("c", "deep"),), "cl"),
    ],
    ids=[
        "frame of the model",
        "__model__",
        "frame of a model inside",
        "model inside",
        "model without a link",
    ],
)
def test_a_joint_at_a_model_holds_the_first_link_of_the_model(inside, held_together, caplog):
    inner = assembled(link("l", 7), name="inner")
    if "deep" in "".join(inside):
        inner = assembled(inner, name="deep")
    read = parse_world(sdf(assembled(*WHEELED, inner, *inside), version="1.7"), "test.world").bodies
    place_of = {"a": 0.0, "b": 2.0, "c": 5.0, "l": 7.0}
    places = [
        {transform_point(b.pose_in_world, part.pose_in_body.position)[0] for part in b.collisions}
        for b in read
    ]
    assert {place_of[name] for name in held_together} in places
    assert caplog.text == ""


def test_a_model_may_name_the_link_that_a_joint_at_the_model_holds():
    model = assembled(*WHEELED, '<frame name="hub"/>', joint("hub", "c"))
    model = model.replace('<model name="m"', '<model name="m" canonical_link="b"')
    names = [body.name for body in parse_world(sdf(model, version="1.7"), "test.world").bodies]
    assert names == ["m::a", "m::b"], "c is part of the body of b"


def test_a_joint_of_a_link_that_is_not_there_is_left_out(caplog):
    read = parse_world(sdf(assembled(*WHEELED, joint("a", "z"))), "test.world").bodies
    assert [body.name for body in read] == ["m::a", "m::b", "m::c"]
    assert "a <joint> of a link that does not exist is left out: test.world:1: model 'm'" in caplog.text


def test_links_that_are_held_together_stand_where_the_state_has_them():
    state = """<state><model name="m"><pose>1 0 0 0 0 0</pose>
        <link name="a"><pose>10 0 0 0 0 1.5707963267948966</pose></link>
        <link name="b"><pose>10 2 0 0 0 1.5707963267948966</pose></link></model></state>"""
    (body,) = parse_world(sdf(assembled(*WHEELED[:2], joint("a", "b")), state), "test.world").bodies
    centres = [transform_point(body.pose_in_world, part.pose_in_body.position) for part in body.collisions]
    assert centres == [pytest.approx((10.0, 0.0, 0.0)), pytest.approx((10.0, 2.0, 0.0))]


# ---------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("not_xml", r"is not valid XML: .*line 3"),
        ("no_world", r":1: .*needs a <world>"),
        ("version", r":1: SDF version '2\.0' is not supported; 1\.3 to 1\.12 are"),
        ("not_sdf", r":1: needs <sdf>.* not <robot>"),
        (
            "radius",
            r":6: model 'pillar' > link 'link' > collision 'collision' > geometry > cylinder: .*<radius>",
        ),
        ("pose", r":6: model 'pillar' > link 'link' > collision 'collision' > pose: .*'20 5 nan 0 0 0'"),
        ("entities", r"entities are refused"),
    ],
)
def test_a_broken_world_is_refused_with_file_line_element_and_value(file, words):
    with pytest.raises(WorldError, match=rf"invalid_{file}\.world.*{words}") as caught:
        load_world(DATA / f"invalid_{file}.world")
    assert isinstance(caught.value, HuskyError)


@pytest.mark.parametrize(
    ("pose", "yaw"), [("<pose/>", 0.0), ('<pose degrees="true">0 0 0 0 0 90</pose>', pi / 2)]
)
def test_a_pose_without_numbers_is_no_offset_and_a_newer_one_may_be_in_degrees(pose, yaw):
    placed = only_thing(model(pose), version="1.9").pose_in_world
    assert (placed.position, yaw_from_quat(placed.quat_xyzw)) == ((0.0, 0.0, 0.0), pytest.approx(yaw))


@pytest.mark.parametrize(
    "path", [DATA / "nowhere.world", DATA, "\0"], ids=["missing", "folder", "not a path"]
)
def test_what_is_no_file_is_refused(path):
    with pytest.raises(WorldError, match="cannot be read") as caught:
        load_world(path)
    assert str(path) in str(caught.value)


DECLARATION = '<?xml version="1.0"?>'
LATIN = DECLARATION.replace("?>", ' encoding="iso-8859-1"?>')
COLUMN = '<model name="Säule"><pose>2 0 0 0 0 0</pose><link name="link"/></model>'


@pytest.mark.parametrize(
    "data",
    [
        "\n\n" + DECLARATION + sdf(COLUMN),
        "<!-- by\nhand -->\n" + DECLARATION + sdf(COLUMN),
        "\ufeff" + DECLARATION + sdf(COLUMN),
        "\ufeff \n" + DECLARATION + sdf(COLUMN),
        sdf("<!-- a -- b --><!----->", COLUMN),
        sdf('<gui><plugin name="R&D">a & b</plugin></gui>', COLUMN),
        sdf("<gui><![CDATA[ <!-- a -- & ]]></gui>", COLUMN),
        sdf("<!-- Säule -->", COLUMN).encode("latin-1"),
        (DECLARATION + sdf(COLUMN)).encode("latin-1"),
        (LATIN + sdf(COLUMN)).encode("latin-1"),
        sdf(COLUMN).encode("utf-16"),
        sdf("<?skip>", COLUMN, "<?skip?>", "<?php a\n?>"),
        sdf(COLUMN) + "\0",
        sdf(COLUMN) + "\0\xff and what follows",
    ],
)
def test_what_gazebos_parser_reads_is_read(data, tmp_path):
    file = tmp_path / "loose.world"
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    (body,) = load_world(file).bodies
    assert (body.name, body.pose_in_world.position) == ("Säule", (2.0, 0.0, 0.0))


def ring(*names):
    """Models that stand relative to each other."""
    return "".join(map(posed_model, names, (*names[1:], names[0])))


BROKEN = [
    (solid("<sphere><radius>0</radius></sphere>"), "sphere > radius: must be greater than zero, not '0'"),
    (solid("<box><size>1 -1 1</size></box>"), "size: must be greater than zero, not '1 -1 1'"),
    (solid("<box><size>1 1</size></box>"), "size: needs 3 finite numbers, not '1 1'"),
    (solid("<cylinder><radius>1</radius></cylinder>"), "<cylinder> needs a <length>"),
    (solid("<plane><normal>0 0 0</normal></plane>"), "normal: needs a direction, not '0 0 0'"),
    (solid("<box><size>1 1 2000</size></box>"), "size (1.0, 1.0, 2000.0) is not within 0.001 to 1000 m"),
    (solid("<box><size>1 1 1</size></box>", "1 two 3 0 0 0"), "pose: needs 6 finite numbers, not '1 two 3"),
    (
        model('<pose rotation_format="quat_xyzw">1 2 3 0 0 0 0</pose>'),
        "needs a rotation in its last four numbers, not '1 2 3 0 0 0 0'",
    ),
    (model("<pose>1e999 0 0 0 0 0</pose>"), "not '1e999 0 0 0 0 0'"),
    ('<model name="m"><static>maybe</static></model>', "static: must be true, false, 1 or 0, not 'maybe'"),
    ("<gravity>down</gravity>", "gravity: needs 3 finite numbers, not 'down'"),
    (saved("<pose>1 b</pose>"), "state > model 'm' > pose: needs 6 finite numbers, not '1 b'"),
    (saved("<scale>1 0 1</scale>"), "state > model 'm' > scale: must be greater than zero, not '1 0 1'"),
    (saved('<link name="link"><pose>nan 0 0 0 0 0</pose></link>'), "> link 'link' > pose: needs 6 finite"),
    (ring("a", "b", "c"), "frames are relative to each other: b > c > a > b"),
    (ring("a"), "frames are relative to each other: a > a"),
    (posed_model("a", "b::b") + posed_model("b", "a"), "frames are relative to each other: b > a > b"),
    (posed_model("a", "a::f", frame("f", "g"), frame("g", "f")), "relative to each other: f > g > f"),
]


@pytest.mark.parametrize(("inside", "sentence"), BROKEN, ids=[sentence for _, sentence in BROKEN])
def test_broken_values_are_refused_in_plain_words(inside, sentence):
    message = refusal(sdf(inside, version="1.7"))
    assert message.startswith("test.world:1: ")
    assert sentence in message


NESTED = "".join(f'<model name="{i}">' for i in range(5000)) + "</model>" * 5000
CHAIN = "".join(frame(i, i + 1) for i in range(5000)) + posed_model("m", "0")
ENTITIES = '<!-- a -- b --><!DOCTYPE sdf [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'
RUNS = ("<!--", "<![CDATA[", "&", "<!-- -->", " ", "<?xml ")
REFUSED = {
    "lines before a late declaration are counted": (
        f"\n<!-- a\n-- b -->{DECLARATION}\n" + sdf("<!-- c --\n -->\n", model("\n<pose>1 b 3</pose>")),
        r"test\.world:7: model 'm' > link 'link' > pose: ",
    ),
    "an entity behind a comment": (ENTITIES + sdf('<model name="&b;"/>'), "entities are refused"),
    "models in each other without end": (sdf(NESTED), "too deeply"),
    "frames without end": (sdf(CHAIN, version="1.7"), "too deeply"),
    "an unknown encoding": (LATIN.replace("iso-8859-1", "klingon") + sdf(), "is not valid XML"),
    "a comment without end in the world": (sdf("<!--" * 100_000), "is not valid XML"),
    **{f"{run} without end": (run * 100_000, "is not valid XML") for run in RUNS},
    **{f"{run} without end before the world": (run * 100_000 + "<sdf", "is not valid XML") for run in RUNS},
}


@pytest.mark.parametrize(("text", "sentence"), REFUSED.values(), ids=REFUSED)
def test_a_file_that_is_no_world_is_refused(text, sentence, tmp_path):
    (tmp_path / "test.world").write_text(text)
    with pytest.raises(WorldError, match=sentence):
        load_world(tmp_path / "test.world")


def numeric_places():
    """Every number in the world that has one of everything: (which element, which word)."""
    for index, element in enumerate(ElementTree.fromstring(EVERYTHING).iter()):
        for position, word in enumerate((element.text or "").split()):
            if re.fullmatch(r"[-\d.e]+", word):
                yield index, position


UNUSED = ("world/include[uri='model://sun']/pose", ".//inertial//*", ".//visual//*", ".//plane/size")


@pytest.mark.parametrize("broken", ["nan", "inf", "-inf", "abc", "1,5", "0x1p3"])
def test_no_broken_number_is_read_in_silence_and_what_changes_the_scene_is_refused(broken, caplog):
    places = list(numeric_places())
    assert len(places) > 60
    for index, position in places:
        root = ElementTree.fromstring(EVERYTHING)
        element = list(root.iter())[index]
        words = element.text.split()
        words[position] = broken
        element.text = " ".join(words)
        caplog.clear()
        text = ElementTree.tostring(root, encoding="unicode")
        unused = [each for path in UNUSED for each in root.iterfind(path)]
        message = caplog.text if element in unused and parse_world(text, "test.world") else refusal(text)
        assert element.tag in message
        assert broken in message


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ("<box><size>0.1 0.0001 0.08</size></box>", (0.1, 0.001, 0.08)),
        ("<cylinder><radius>0.3</radius><length>1e-5</length></cylinder>", (0.6, 0.6, 0.001)),
        ("<sphere><radius>1e-9</radius></sphere>", (0.001, 0.001, 0.001)),
    ],
)
def test_a_sheet_thinner_than_physics_can_use_is_as_thick_as_it_can_and_is_told(shape, size, caplog):
    assert only_thing(solid(shape)).collisions[0].shape.size == size
    assert "a shape thinner than 0.001 m is read as that thick: test.world:1: model 'm'" in caplog.text


@pytest.mark.parametrize("place", ["models/ball", "worlds/models/ball", "worlds/ball", "ball"])
def test_an_include_is_looked_up_beside_the_world_as_a_mesh_is(place, tmp_path, caplog):
    world = tmp_path / "worlds" / "w.world"
    (tmp_path / place).mkdir(parents=True)
    world.parent.mkdir(exist_ok=True)
    (tmp_path / place / "model.sdf").write_text(BALL.format(radius=0.3))
    world.write_text(sdf(include("ball")))
    (body,) = load_world(world).bodies
    assert (body.name, body.collisions[0].shape.radius) == ("ball", 0.3)
    assert not caplog.records


# ---------------------------------------------------------------------------- bounds


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        ("<gravity>0 0 -1e300</gravity>", "gravity: must not be stronger than 1000 m/s"),
        (
            solid("<sphere><radius>1e300</radius></sphere>"),
            "model 'm'.*: size .* is not within 0.001 to 1000 m",
        ),
    ],
)
def test_numbers_that_physics_cannot_use_are_refused_by_file_and_value(inside, sentence):
    assert re.match(f"test.world:1: {sentence}", refusal(sdf(inside)))


def test_a_tree_of_includes_that_doubles_with_every_level_has_an_end(tmp_path, monkeypatch):
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path))
    for level in range(14):
        inside = "".join(include(f"m{level + 1}", f"<name>{name}</name>") for name in "ab" if level < 13)
        make_model(tmp_path, f"m{level}", f"<sdf version='1.6'><model name='m'>{inside}</model></sdf>")
    with pytest.raises(WorldError, match="more than 1000 models are included"):
        parse_world(sdf(include("m0")), "w")
