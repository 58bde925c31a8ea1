"""Films of two short drives: every frame is looked at as numbers."""

import itertools

import numpy as np
import pytest
from evaluated_drives import evaluate_runs
from matplotlib.figure import Figure
from PIL import Image
from straight_drive import obstacle, straight_scene

from bags.errors import BagError
from bags.evaluation.drive import PREDICTION
from bags.figures import film
from bags.figures.film import FilmOptions
from bags.storage.columns import Columns

SHORT = FilmOptions(width_px=480, fps=10, begin_s=2.0, end_s=2.4)


@pytest.fixture(scope='module')
def gif(runs, tmp_path_factory):
    """Return the path of a film of five frames."""
    out = tmp_path_factory.mktemp('film') / 'film.gif'
    assert film.write_film(runs, out, SHORT) == 5
    return out


def test_a_film_has_a_frame_per_step_and_keeps_the_time_of_the_drive(gif):
    with Image.open(gif) as picture:
        assert picture.width == SHORT.width_px
        assert picture.n_frames == 5
        assert picture.info['loop'] == 0
        durations, frames = [], []
        for k in range(picture.n_frames):
            picture.seek(k)
            durations.append(picture.info['duration'])
            frames.append(np.asarray(picture.convert('RGB')))
    assert durations == [100] * 4 + [film.HOLD_MS]
    for one, other in itertools.pairwise(frames):
        changed = np.any(one != other, axis=2)
        assert 0.002 < changed.mean() < 0.3
    assert gif.stat().st_size < 200_000


def test_the_car_its_wheels_and_the_obstacles_are_where_the_bag_says(runs):
    run = runs[0]
    panel, road = Figure().subplots(1, 2)
    strip = film.Strip(panel, road, run)
    strip.show(2.5)
    motion, outline = run.drive.motion, run.drive.facts.outline
    k = int(np.searchsorted(run.series.t, 2.5))
    corners = strip.artists['body', 0].get_xy()
    assert corners[:, 0].max() == pytest.approx(motion.x[k] + outline.front, abs=0.01)
    assert corners[:, 0].min() == pytest.approx(motion.x[k] - outline.rear, abs=0.01)
    assert np.ptp(corners[:, 1]) == pytest.approx(outline.width, abs=0.01)
    front, rear = (strip.artists['wheel', k].get_xy() for k in (0, 3))
    angles = [np.arctan2(*(xy[0] - xy[3])[::-1]) for xy in (front, rear)]
    steer = run.drive.inputs.steer[k]
    assert angles[0] == pytest.approx(steer, abs=1e-6) != pytest.approx(0.0, abs=1e-3)
    assert angles[1] == pytest.approx(0.0, abs=1e-6)
    moving = strip.artists['obstacle', run.drive.scene.obstacles[1].id].center
    assert moving == pytest.approx((20.0 + 5.0 * 2.5, 4.0), abs=0.3)
    # the camera: the car is at 0 along the road, the road's middle at 0 across
    at = strip.view.transform((motion.x[k], motion.y[k]))
    assert at == pytest.approx((0.0, motion.y[k]), abs=1e-6)
    assert strip.speed.get_text() == '72 km/h'
    X, _ = strip.artists['plan', 0].get_data()
    assert X[0] == pytest.approx(motion.x[k], abs=0.01)


def test_what_the_car_reacts_to_is_in_view(runs, make_drive):
    # a plan reaches 80 m ahead; someone comes from 9 m beside the middle of the road, 60 m ahead
    plan = runs[0].sent(PREDICTION)[0]
    far = plan._replace(X=plan.X[0] + np.linspace(0.0, 80.0, len(plan.X)))
    coming = obstacle(1, 60.0, 9.0, vy=-1.0, radius=0.4)
    (run,) = evaluate_runs({'mpcc': make_drive(scene=straight_scene([coming]))})
    panel, road = Figure().subplots(1, 2)
    run.tables = {PREDICTION: Columns(np.array([far.stamp_ns]), np.zeros(1), values=[far])}
    strip = film.Strip(panel, road, run, film.window([run]))
    strip.show(0.0)
    for point in ((far.X[-1], 0.0), strip.artists['obstacle', 1].center):
        x, y = strip.view.transform(point)
        assert road.get_xlim()[0] <= x <= road.get_xlim()[1] + 1e-6
        assert road.get_ylim()[0] <= y <= road.get_ylim()[1]


def test_the_camera_turns_with_the_road(make_drive):
    angle = np.radians(60.0)
    c, s = np.cos(angle), np.sin(angle)
    item = make_drive()
    turned = np.array([[c, s], [-s, c]])
    scene = item.scene._replace(
        **{name: getattr(item.scene, name) @ turned for name in ('reference', 'left', 'right')}
    )
    x, y = np.column_stack([item.motion.x, item.motion.y]).dot(turned).T
    motion = item.motion._replace(x=x, y=y, yaw=item.motion.yaw + angle)
    (run,) = evaluate_runs({'mpcc': item._replace(motion=motion, scene=scene)})
    panel, road = Figure().subplots(1, 2)
    strip = film.Strip(panel, road, run)
    strip.show(2.0)
    ahead = strip.view.transform(run.drive.scene.reference[60])
    assert ahead == pytest.approx((20.0, 0.0), abs=0.1)


def test_a_film_ends_with_the_longest_run_and_plays_at_any_speed(runs):
    assert film.frame_times(runs, FilmOptions(fps=10))[[0, -1]] == pytest.approx([0.0, 5.0])
    slow = film.frame_times(runs, FilmOptions(fps=10, speed=0.5))
    assert np.diff(slow) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ('name', 'options', 'said'),
    [
        ('film.avi', FilmOptions(), 'film.avi: a film ends with .gif or .mp4'),
        ('no/film.gif', FilmOptions(), 'there is no folder'),
        ('film.gif', FilmOptions(width_px=100), 'width_px is 100; allowed 480 to 1920'),
        ('film.gif', FilmOptions(fps=0), 'fps is 0; allowed 1 to 50'),
        ('film.gif', FilmOptions(speed=-1), 'speed is -1; allowed 0.05 to 10'),
        ('film.gif', FilmOptions(begin_s=9.0), 'no frame lies between 9 s and 5 s'),
        ('film.gif', FilmOptions(begin_s=2.0, end_s=1.0), 'no frame lies between 2 s and 1 s'),
        ('film.mp4', SHORT, 'needs the program ffmpeg'),
    ],
)
def test_what_gives_no_film_is_refused_with_the_reason(
    runs, tmp_path, monkeypatch, name, options, said
):
    monkeypatch.setenv('PATH', str(tmp_path))
    with pytest.raises(BagError) as refused:
        film.write_film(runs, tmp_path / name, options)
    assert said in str(refused.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.needs('ffmpeg')
def test_a_video_is_written_where_ffmpeg_is(runs, tmp_path):
    out = tmp_path / 'film.mp4'
    assert film.write_film(runs, out, SHORT) == 5
    assert out.read_bytes()[4:8] == b'ftyp'


def test_the_command_makes_a_film_of_bags(drives, write_bag, tmp_path, bags_prints):
    bag = write_bag(drives['mpcc'])
    out = tmp_path / 'film.gif'
    output = bags_prints('film', bag, '--out', out, '--width', 480, '--from', 1, '--to', 1.1)
    assert output.startswith(f'{out}: 2 frames, 0.0')
    with Image.open(out) as picture:
        assert picture.n_frames == 2
