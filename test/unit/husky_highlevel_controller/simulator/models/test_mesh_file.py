"""Mesh files of worlds: found, read in metres, kept within bounds, and named where they are left out."""

import re

import pytest
from trimesh import creation

from husky_highlevel_controller.datatypes import Pose
from husky_highlevel_controller.simulator.models import mesh_file
from husky_highlevel_controller.simulator.models.mesh_file import MeshError, MeshFiles, find_mesh
from husky_highlevel_controller.simulator.models.sdf_world import load_world, parse_model
from husky_highlevel_controller.simulator.models.urdf_object import parse_urdf_object

SOLID = creation.box((2.0, 4.0, 1.0))


@pytest.fixture(autouse=True)
def no_folders(monkeypatch):
    for variable in ("GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(variable, raising=False)


def world(folder, *models):
    path = folder / "w.world"
    path.write_text(f'<sdf version="1.6"><world name="w">{"".join(models)}</world></sdf>')
    return path


def walls(uri, more="", static=1, name="house"):
    shape = f"<geometry><mesh><uri>{uri}</uri>{more}</mesh></geometry>"
    link = f'<link name="l"><collision name="c">{shape}</collision></link>'
    return f'<model name="{name}"><static>{static}</static>{link}</model>'


def size_of(body):
    return body.collisions[0].shape.size


@pytest.mark.parametrize("ending", ["stl", "obj", "dae", "STL"])
def test_triangles_of_each_kind_of_file_are_the_walls(ending, tmp_path, caplog):
    SOLID.export(tmp_path / f"house.{ending}", file_type=ending.lower())
    (body,) = load_world(world(tmp_path, walls(f"house.{ending}", "<scale>1 1 2</scale>"))).bodies
    assert size_of(body) == pytest.approx((2.0, 4.0, 2.0))
    assert body.collisions[0].shape.faces.shape == (12, 3)
    assert not caplog.records


def test_a_dae_counts_in_its_unit_with_the_places_of_its_nodes(tmp_path):
    (tmp_path / "house.dae").write_text(COLLADA)
    (body,) = load_world(world(tmp_path, walls("house.dae"))).bodies
    mesh = body.collisions[0].shape
    assert mesh.bounds.tolist() == [[0.0, 0.0, 0.0], pytest.approx([1.1, 0.1, 0.0])]
    (part,) = load_world(world(tmp_path, walls("house.dae", "<submesh><name>b</name></submesh>"))).bodies
    assert size_of(part) == pytest.approx((0.1, 0.1, 0.0))


@pytest.mark.parametrize("scale", [1e15, 1e-5])
def test_a_mesh_larger_or_smaller_than_physics_can_use_is_left_out_by_name(scale, tmp_path, caplog):
    SOLID.export(tmp_path / "pot.stl")
    (body,) = load_world(world(tmp_path, walls("pot.stl", f"<scale>{scale} {scale} {scale}</scale>"))).bodies
    assert not body.collisions
    assert "a mesh whose size is not within 0.001 to 1000 m is left out" in caplog.text
    assert f"{4.0 * scale:g} m" in caplog.text


def bomb(levels, inmost):
    """A file whose nodes have two instances of the next one each."""
    twice = (
        '<node id="n{0}"><instance_node url="#n{1}"/>'
        '<node><translate>0 0 {2}</translate><instance_node url="#n{1}"/></node></node>'
    )
    nodes = "".join(twice.format(n, n + 1, 2 ** (n % 50)) for n in range(levels)) + inmost
    scene = COLLADA.replace(
        "<library_visual_scenes>", f"<library_nodes>{nodes}</library_nodes><library_visual_scenes>"
    )
    return scene.replace('<node name="a">', '<node name="a"><instance_node url="#n0"/>')


@pytest.mark.parametrize(
    ("levels", "inmost", "words"),
    [
        (40, '<node id="n40"/>', "has more than 20000 nodes"),
        (5000, '<node id="n5000"/>', "a mesh cannot be read: RecursionError"),
        (
            12,
            f"""<node id="n12">{'<instance_geometry url="#a-mesh"/>' * 800}</node>""",
            "more than 3000000 triangles",
        ),
        (1, '<node id="n1"><instance_node url="#n0"/></node>', "node 'n0' contains itself"),
    ],
)
def test_a_dae_whose_instances_no_memory_holds_is_left_out(levels, inmost, words, tmp_path, caplog):
    (tmp_path / "bomb.dae").write_text(bomb(levels, inmost))
    (body,) = load_world(world(tmp_path, walls("bomb.dae"))).bodies
    assert not body.collisions
    assert any(words in message and "bomb.dae" in message for message in caplog.messages), caplog.messages


def test_a_dae_with_a_few_instances_has_the_triangles_of_each(tmp_path):
    (tmp_path / "house.dae").write_text(bomb(3, '<node id="n3"><instance_geometry url="#a-mesh"/></node>'))
    (body,) = load_world(world(tmp_path, walls("house.dae"))).bodies
    assert len(body.collisions[0].shape.faces) == 8 + 1, "the one of node a is there twice"


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_geometries>{}</library_geometries>
<library_visual_scenes><visual_scene id="s"><node name="a"><instance_geometry url="#a-mesh"/></node>
<node name="b"><translate>100 0 0</translate><instance_geometry url="#b-mesh"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>""".format(
    "".join(
        f"""<geometry id="{name}-mesh"><mesh>
<source id="{name}p"><float_array id="{name}f" count="9">0 0 0 10 0 0 0 10 0</float_array><technique_common>
<accessor source="#{name}f" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="{name}v"><input semantic="POSITION" source="#{name}p"/></vertices><triangles count="1">
<input semantic="VERTEX" source="#{name}v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry>"""
        for name in "ab"
    )
)


@pytest.mark.parametrize(
    ("uri", "file", "variable", "folder"),
    [
        ("meshes/a.stl", "worlds/meshes/a.stl", None, None),
        ("file://meshes/a.stl", "media/meshes/a.stl", "GAZEBO_RESOURCE_PATH", "media"),
        ("model://house/meshes/a.stl", "models/house/meshes/a.stl", "GAZEBO_MODEL_PATH", "models"),
        ("model://house/meshes/a%20b.stl", "models/house/meshes/a b.stl", None, None),
        ("model://house/a.stl", "worlds/house/a.stl", None, None),
        ("package://lab/a.stl", "src/lab/a.stl", "ROS_PACKAGE_PATH", "src"),
        ("package://lab/a.stl", "src/lab/a.stl", "ROS_PACKAGE_PATH", "src/lab"),
        ("file://{root}/a.stl", "a.stl", None, None),
        ("{root}/a.stl", "a.stl", None, None),
    ],
)
def test_a_mesh_is_looked_up_where_gazebo_and_ros_do(uri, file, variable, folder, tmp_path, monkeypatch):
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).touch()
    if variable:
        monkeypatch.setenv(variable, f"/nowhere:{tmp_path / folder}")
    found = find_mesh(uri.format(root=tmp_path), str(tmp_path / "worlds" / "w.world"))
    assert found == tmp_path / file


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("gone.stl", None, "a mesh is not on this machine, and is left out"),
        ("x.fbx", b"", r"is not a file of a supported type \(.dae, .stl, .obj\)"),
        ("x.stl", b"solid nothing", "a mesh holds no triangles"),
        ("x.obj", b"v 0 0 0\nf 1 2 3\n", "a mesh cannot be read: .*Error"),
        ("x.dae", b"<COLLADA", "a mesh cannot be read: .*is not valid XML"),
        ("x.dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA>&b;</COLLADA>', "XML entities are refused"),
        ("x.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 nan\nf 1 2 3\n", "a mesh has corners that are not finite"),
        ("x.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 2\n", "a mesh holds no triangles"),
        ("\0.stl", None, "is not on this machine"),
    ],
)
def test_a_mesh_that_cannot_be_had_leaves_its_model_out_by_name(name, content, reason, tmp_path, caplog):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    if name.startswith("\0"):
        with pytest.raises(MeshError, match=reason):
            MeshFiles().read(name, "w.world")
        return
    (body,) = load_world(world(tmp_path, walls(name))).bodies
    assert body.collisions == ()
    what, left = caplog.messages
    assert name in what
    assert "model 'house'" in what
    assert re.search(reason, what)
    assert left.startswith("world 'w': the lidar sees nothing, because no shape of its 1 models is left;")


def test_the_log_says_what_is_left_only_where_nothing_is(tmp_path, caplog):
    ground = "<include><uri>model://ground_plane</uri></include>"
    absent = ["<include><uri>model://barn</uri></include>", walls("gone.stl"), walls("gone.dae", name="shed")]
    load_world(world(tmp_path, ground, *absent))
    assert caplog.messages[-1].startswith(
        "world 'w': the lidar sees nothing, because no shape of its 3 models is left;"
    )
    caplog.clear()
    box = "<geometry><box><size>1 1 1</size></box></geometry>"
    post = f'<model name="p"><link name="l"><collision name="c">{box}</collision></link></model>'
    far = post.replace('<collision name="c">', '<collision name="c"><pose>0 2e4 0 0 0 0</pose>')
    load_world(world(tmp_path, ground, far))
    assert "the lidar sees nothing" in caplog.messages[-1]
    caplog.clear()
    load_world(world(tmp_path, ground, *absent, post))
    load_world(world(tmp_path, ground))
    assert "the lidar sees nothing" not in caplog.text


def test_large_files_are_left_out_and_many_triangles_made_fewer(tmp_path, caplog, monkeypatch):
    creation.icosphere(subdivisions=3).export(tmp_path / "ball.stl")  # 1280 triangles, 64 kB
    monkeypatch.setattr(mesh_file, "MAX_FACES", 500)
    (body,) = load_world(world(tmp_path, walls("ball.stl"))).bodies
    assert 200 < len(body.collisions[0].shape.faces) <= 500
    assert "made coarser: ball.stl (1280)" in caplog.text
    monkeypatch.setattr(mesh_file, "MAX_BYTES", 1000)
    assert load_world(world(tmp_path, walls("ball.stl"))).bodies[0].collisions == ()
    assert "a mesh has 0 MB, above the limit of 0 MB, and is left out" in caplog.text


def test_the_files_of_a_world_are_read_once_and_bounded_together(tmp_path, caplog):
    for name in "ab":
        SOLID.export(tmp_path / f"{name}.stl")
    files = MeshFiles(bytes_left=1000)
    source = str(tmp_path / "w.world")
    assert files.read("a.stl", source) is files.read("a.stl", source)
    with pytest.raises(MeshError, match="exceeds the limit of 200 MB for all meshes together"):
        files.read("b.stl", source)


def test_a_mesh_that_can_move_is_said_to_collide_by_its_hull(tmp_path, caplog):
    SOLID.export(tmp_path / "a.stl")
    (body,) = load_world(world(tmp_path, walls("a.stl", static=0))).bodies
    assert body.mass == 1.0
    (message,) = caplog.messages
    assert "convex hull" in message
    assert "model 'house'" in message


def test_spawned_models_have_meshes_too(tmp_path, caplog):
    SOLID.export(tmp_path / "a.stl")
    text = f'<sdf version="1.6">{walls(f"file://{tmp_path}/a.stl")}</sdf>'
    (body,) = parse_model(text, "n", Pose())
    urdf = """<robot name="r"><link name="l"><collision><geometry>
        <mesh filename="{}" scale="0.5 1 1"/></geometry></collision></link></robot>"""
    spawned = parse_urdf_object(urdf.format(f"file://{tmp_path}/a.stl"), "n", Pose())
    assert (size_of(body), size_of(spawned)) == ((2.0, 4.0, 1.0), (1.0, 4.0, 1.0))
