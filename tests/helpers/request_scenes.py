"""Scenes that requests are made about."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from palpate.scene.load import parse_scene
from palpate.scene.scene import Scene

BOX, ROUND = "box", "cylinder"
GREY = "0.5 0.5 0.5"
RED, BLUE, GREEN, YELLOW = "0.8 0.1 0.1", "0.1 0.2 0.8", "0.1 0.6 0.1", "0.9 0.8 0.2"


class Thing(NamedTuple):
    """A free body that stands at (x, y) m, its foot at `z`."""

    name: str
    x: float
    y: float
    colour: str = GREY
    shape: str = ROUND
    z: float = 0.0

    def mjcf(self) -> str:
        size = ".02 .02 .03" if self.shape == BOX else ".02 .03"
        return (
            f'<body name="{self.name}" pos="{self.x} {self.y} {self.z + 0.03}"><freejoint/><geom '
            f'type="{self.shape}" size="{size}" rgba="{self.colour} 1" friction="0.5"/></body>'
        )


SCENES: dict[str, tuple[str, tuple[Thing, ...]]] = {
    "kitchen": (
        "table",
        (
            Thing("bottle", 0.5, -0.3),
            Thing("mug", 0.5, 0.3),
            Thing("red_box", 0.4, 0.0, RED, BOX),
            Thing("blue_box", 0.5, 0.0, BLUE, BOX),
        ),
    ),
    "workshop": (
        "workbench",
        (
            Thing("hammer", 0.5, -0.3, shape=BOX),
            Thing("screwdriver", 0.5, 0.0, shape=BOX),
            Thing("block", 0.5, 0.2, shape=BOX),
            Thing("battery", 0.5, 0.3),
        ),
    ),
    "shop": (
        "shelf",
        (
            Thing("blue_bottle", 0.5, -0.3, BLUE),
            Thing("green_bottle", 0.5, 0.0, GREEN),
            Thing("yellow_can", 0.5, 0.1, YELLOW),
        ),
    ),
    "vials": (
        "lab_bench",
        (
            Thing("beaker", 0.5, -0.3),
            Thing("vial_1", 0.5, 0.2),
            Thing("vial_2", 0.5, 0.1),
            Thing("vial_3", 0.5, -0.2),
        ),
    ),
    "boxes": (
        "floor_plate",
        (
            Thing("red_box", 0.4, 0.0, RED, BOX),
            Thing("box", 0.4, 0.1, shape=BOX),
            Thing("crate", 0.6, -0.3, shape=BOX),
            Thing("tin", 0.4, -0.3),
        ),
    ),
    "foam": ("foam", (Thing("duck", 0.5, 0.0, YELLOW, BOX),)),
    "werkstatt": ("tisch", (Thing("flasche", 0.5, -0.2), Thing("becher", 0.5, 0.2))),
    "office": (
        "desk",
        (
            Thing("stapler", 0.5, -0.2, shape=BOX),
            Thing("notebook", 0.5, 0.0, shape=BOX),
            Thing("tape", 0.5, 0.2),
        ),
    ),
    "fruit": (
        "counter",
        (
            Thing("apple", 0.5, -0.3, RED),
            Thing("pear", 0.5, -0.1, GREEN),
            Thing("left_bowl", 0.5, 0.3),
            Thing("right_bowl", 0.5, 0.1),
        ),
    ),
    "garage": (
        "bench",
        (
            Thing("wrench", 0.5, -0.3, shape=BOX),
            Thing("drill", 0.5, -0.05, shape=BOX),
            Thing("paint_can", 0.5, 0.15, GREEN),
            Thing("oil_can", 0.5, 0.3, "0.1 0.1 0.1"),
        ),
    ),
    "picnic": (
        "picnic_table",
        (
            Thing("thermos", 0.4, -0.2),
            Thing("juice_carton", 0.4, 0.0, shape=BOX),
            Thing("sandwich_box", 0.6, 0.0, BLUE, BOX),
            Thing("orange_ball", 0.4, 0.25, "0.9 0.5 0.1"),
        ),
    ),
    "bath": (
        "washstand",
        (
            Thing("soap", 0.5, 0.1, shape=BOX),
            Thing("sponge", 0.5, 0.25, YELLOW, BOX),
            Thing("shampoo_bottle", 0.5, -0.1),
            Thing("cup", 0.5, -0.3),
        ),
    ),
    "tower": (
        "table",
        (
            Thing("crate", 0.5, -0.2, "0.6 0.4 0.2", BOX),
            Thing("radio", 0.5, -0.2, shape=BOX, z=0.06),
            Thing("vase", 0.5, 0.2),
            Thing("candle", 0.5, 0.35),
        ),
    ),
    "taller": (
        "mesa",
        (
            Thing("botella", 0.5, -0.2),
            Thing("caja_roja", 0.5, 0.0, RED, BOX),
            Thing("caja_azul", 0.5, 0.25, BLUE, BOX),
        ),
    ),
    "atelier": (
        "etabli",
        (
            Thing("marteau", 0.5, -0.2, shape=BOX),
            Thing("pince", 0.5, 0.0, shape=BOX),
            Thing("bouteille", 0.5, 0.2),
        ),
    ),
    "cucina": (
        "tavolo",
        (Thing("bottiglia", 0.5, -0.2), Thing("tazza", 0.5, 0.0), Thing("mela", 0.5, 0.2, RED)),
    ),
    "dentist": (
        "tray",
        (
            Thing("mirror", 0.4, -0.3),
            Thing("probe", 0.4, -0.1),
            Thing("tweezers", 0.4, 0.1, shape=BOX),
            Thing("red_cup", 0.55, 0.25, RED),
            Thing("blue_cup", 0.55, -0.2, BLUE),
        ),
    ),
    "bakery": (
        "pastry_board",
        (
            Thing("loaf", 0.5, -0.3, "0.6 0.4 0.2", BOX),
            Thing("bun", 0.5, -0.15, "0.7 0.5 0.3"),
            Thing("flour_jar", 0.5, 0.05),
            Thing("sugar_jar", 0.5, 0.2),
            Thing("rolling_pin", 0.4, 0.32),
        ),
    ),
    "aquarium": (
        "rack",
        (
            Thing("green_bucket", 0.45, -0.25, GREEN),
            Thing("yellow_bucket", 0.45, 0.25, YELLOW),
            Thing("filter", 0.45, 0.0, shape=BOX),
            Thing("pump", 0.6, 0.0, shape=BOX),
            Thing("food_tin", 0.62, -0.2),
        ),
    ),
    "praxis": (
        "regal",
        (
            Thing("dose", 0.5, -0.2),
            Thing("schachtel", 0.5, 0.0, shape=BOX),
            Thing("kanne", 0.5, 0.2),
        ),
    ),
    "farmacia": (
        "mostrador",
        (
            Thing("frasco", 0.5, -0.2),
            Thing("caja_verde", 0.5, 0.0, GREEN, BOX),
            Thing("caja_amarilla", 0.5, 0.2, YELLOW, BOX),
        ),
    ),
    "boulangerie": (
        "comptoir",
        (
            Thing("pot", 0.5, -0.2),
            Thing("boite_rouge", 0.5, 0.0, RED, BOX),
            Thing("boite_bleue", 0.5, 0.2, BLUE, BOX),
        ),
    ),
    "acquario": (
        "mensola",
        (
            Thing("barattolo", 0.5, -0.2),
            Thing("secchio", 0.5, 0.0),
            Thing("scatola", 0.5, 0.2, shape=BOX),
        ),
    ),
    "post_office": (
        "mail_desk",
        (
            Thing("large_parcel", 0.55, -0.3, "0.6 0.4 0.2", BOX),
            Thing("small_parcel", 0.55, -0.1, "0.6 0.4 0.2", BOX),
            Thing("stamp_pad", 0.4, 0.05, shape=BOX),
            Thing("glue_bottle", 0.55, 0.1),
            Thing("tape_dispenser", 0.55, 0.32, shape=BOX),
        ),
    ),
    "music_room": (
        "sideboard",
        (
            Thing("metronome", 0.5, -0.3, shape=BOX),
            Thing("rosin_tin", 0.5, -0.15),
            Thing("tambourine", 0.5, 0.02),
            Thing("red_maraca", 0.5, 0.18, RED),
            Thing("blue_maraca", 0.5, 0.33, BLUE),
        ),
    ),
    "balcony": (
        "garden_table",
        (
            Thing("wooden_crate", 0.5, -0.25, "0.6 0.4 0.2", BOX),
            Thing("lantern", 0.5, -0.25, z=0.06),
            Thing("clay_pot", 0.5, 0.0, "0.7 0.35 0.2"),
            Thing("plastic_pot", 0.5, 0.15, GREEN),
            Thing("watering_can", 0.5, 0.32),
            Thing("trowel", 0.38, -0.1, shape=BOX),
        ),
    ),
    "postamt": (
        "tresen",
        (
            Thing("paket", 0.5, -0.2, shape=BOX),
            Thing("stempel", 0.5, 0.0),
            Thing("leimflasche", 0.5, 0.2),
        ),
    ),
    "balcon": (
        "repisa",
        (
            Thing("maceta", 0.5, -0.2),
            Thing("regadera", 0.5, 0.0),
            Thing("pala", 0.5, 0.2, shape=BOX),
        ),
    ),
    "musique": (
        "commode",
        (
            Thing("tambour", 0.5, -0.2),
            Thing("flute", 0.5, 0.0),
            Thing("metronome", 0.5, 0.2, shape=BOX),
        ),
    ),
    "ufficio_postale": (
        "bancone",
        (
            Thing("pacco_grande", 0.5, -0.2, shape=BOX),
            Thing("pacco_piccolo", 0.5, 0.0, shape=BOX),
            Thing("timbro", 0.5, 0.2),
        ),
    ),
    "climbing_gym": (
        "front_desk",
        (
            Thing("chalk_bag", 0.5, -0.32),
            Thing("can", 0.5, -0.16),
            Thing("carabiner", 0.5, 0.0, shape=BOX),
            Thing("red_helmet", 0.5, 0.16, RED),
            Thing("blue_helmet", 0.5, 0.32, BLUE),
        ),
    ),
    "model_railway": (
        "baseboard",
        (
            Thing("red_engine", 0.42, -0.25, RED, BOX),
            Thing("green_engine", 0.42, 0.25, GREEN, BOX),
            Thing("tanker", 0.42, 0.0),
            Thing("signal_box", 0.6, 0.0, shape=BOX),
            Thing("water_tower", 0.6, -0.25),
        ),
    ),
    "pharmacy": (
        "dispensary_shelf",
        (
            Thing("pill_box", 0.5, -0.33, shape=BOX),
            Thing("syrup_bottle", 0.5, -0.17, "0.4 0.2 0.1"),
            Thing("litre_jug", 0.5, 0.0),
            Thing("brass_weight", 0.5, 0.16, "0.8 0.6 0.2"),
            Thing("inch_ruler", 0.5, 0.33, shape=BOX),
        ),
    ),
    "kletterhalle": (
        "theke",
        (Thing("helm", 0.5, -0.2), Thing("dose", 0.5, 0.0), Thing("beutel", 0.5, 0.2)),
    ),
    "maqueta": (
        "tablero",
        (
            Thing("vagon", 0.5, -0.2, shape=BOX),
            Thing("locomotora", 0.5, 0.0, shape=BOX),
            Thing("caja", 0.5, 0.2, shape=BOX),
        ),
    ),
    "pharmacie": (
        "etagere",
        (Thing("flacon", 0.5, -0.2), Thing("bocal", 0.5, 0.0), Thing("tube", 0.5, 0.2)),
    ),
    "palestra": (
        "scaffale",
        (Thing("casco", 0.5, -0.2), Thing("corda", 0.5, 0.0), Thing("lattina", 0.5, 0.2)),
    ),
    "cafe": (
        "coffee_table",
        (
            Thing("teapot", 0.5, 0.3),
            Thing("paper_cup", 0.5, 0.15, "0.95 0.95 0.95"),
            Thing("milk_jug", 0.5, -0.05, BLUE),
            Thing("sugar_bowl", 0.5, -0.2),
            Thing("biscuit_tin", 0.6, -0.33, RED, BOX),
        ),
    ),
    "greenhouse": (
        "potting_bench",
        (
            Thing("watering_can", 0.5, 0.25, GREEN),
            Thing("flower_pot", 0.5, 0.0, "0.7 0.35 0.2"),
            Thing("trowel", 0.5, -0.15, shape=BOX),
            Thing("seed_packet", 0.5, -0.3, YELLOW, BOX),
        ),
    ),
    "nursery": (
        "play_table",
        (
            Thing("toy_car", 0.5, -0.3, YELLOW, BOX),
            Thing("red_cube", 0.5, -0.1, RED, BOX),
            Thing("blue_cube", 0.5, 0.05, BLUE, BOX),
            Thing("rattle", 0.4, 0.3),
            Thing("toy_train", 0.6, 0.3, GREEN, BOX),
        ),
    ),
    "camping": (
        "camp_table",
        (
            Thing("lantern", 0.45, -0.3),
            Thing("gas_canister", 0.45, -0.1, BLUE),
            Thing("mallet", 0.45, 0.1, shape=BOX),
            Thing("steel_mug", 0.45, 0.3),
            Thing("plastic_mug", 0.6, 0.3, RED),
        ),
    ),
    "buero": (
        "schreibtisch",
        (
            Thing("locher", 0.5, -0.3, shape=BOX),
            Thing("tasse", 0.5, -0.1),
            Thing("blaue_dose", 0.5, 0.1, BLUE),
            Thing("gruene_dose", 0.5, 0.25, GREEN),
        ),
    ),
}
STACK = """
  <body name="table" pos=".5 0 ?"><geom name="plate" type="box" size=".5 .5 .02" friction="0.5"/></body>
  <body name="board" pos=".5 .25 0.01"><geom type="box" size=".1 .1 .01" friction="0.5"/></body>
  {things}"""
PILED = (
    Thing("wooden_block", 0.5, -0.2, "0.6 0.4 0.2", BOX),
    Thing("red_cube", 0.5, -0.2, RED, BOX, 0.06),
    Thing("can", 0.5, 0.0),
    Thing("jar", 0.5, 0.25, z=0.02),
)


@cache
def scene(name: str) -> Scene:
    """One of the scenes; heights of surfaces and all masses are missing."""
    if name == "stack":
        inside = STACK.format(things="".join(thing.mjcf() for thing in PILED))
    else:
        surface, things = SCENES[name]
        inside = (
            f'<body name="{surface}" pos=".5 0 ?"><geom type="box" size=".5 .5 .02" friction="0.5"/>'
            "</body>" + "".join(thing.mjcf() for thing in things)
        )
    return parse_scene(f'<mujoco><worldbody><site name="robot_base"/>{inside}</worldbody></mujoco>')
