"""Attributes of things as words of eight languages: colours, sizes, materials and shapes."""

# ruff: noqa: E501  the tables are data
from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nav_bridge.words import fold

_COLOURS = {
    "red": "red rot rote roter rotes roten rouge rojo roja rosso rossa красный красная красное 红 红色 赤 赤い",
    "orange": "orange orangefarben orangene naranja arancione оранжевый оранжевая 橙 橙色 橘色 オレンジ オレンジ色",
    "yellow": "yellow gelb gelbe gelber gelbes gelben jaune amarillo amarilla giallo gialla желтый желтая желтое 黄 黄色 黄色い",
    "green": "green grün grüne grüner grünes grünen vert verte verde зеленый зеленая зеленое 绿 绿色 緑 緑色",
    "blue": "blue blau blaue blauer blaues blauen bleu bleue azul blu azzurro azzurra синий синяя синее голубой 蓝 蓝色 青 青い",
    "purple": "purple violet lila violett violette morado morada viola фиолетовый 紫 紫色",
    "pink": "pink rosa rose розовый 粉色 ピンク",
    "brown": "brown braun braune brauner braunes marron marrón marrone коричневый коричневая 棕色 茶色",
    "black": "black schwarz schwarze schwarzer schwarzes schwarzen noir noire negro negra nero nera черный черная черное 黑 黑色 黒 黒い",
    "white": "white weiß weiße weißer weißes weißen blanc blanche blanco blanca bianco bianca белый белая белое 白 白色 白い",
    "grey": "grey gray grau graue grauer graues gris grise grigio grigia серый серая серое 灰色",
    "beige": "beige cream бежевый 米色",
}
_SIZES = {
    "small": "small little tiny mini compact klein kleine kleiner kleines kleinen petit petite pequeño pequeña piccolo piccola маленький маленькая маленькое 小 小さい",
    "large": "large big huge great groß große großer großes großen grand grande gran grosso большой большая большое 大 大きい",
    "tall": "tall high hoch hohe hoher hohes haut haute alto alta высокий высокая",
    "low": "low niedrig niedrige bas basse bajo baja basso bassa низкий низкая",
    "long": "long lang lange langer langes longue largo larga lungo lunga длинный длинная",
    "narrow": "narrow slim thin schmal schmale",
    "wide": "wide broad breit breite",
}
# Sizes are compared: what is not the small one is the large one.
OPPOSITES: Mapping[str, str] = MappingProxyType(
    {"small": "large", "large": "small", "tall": "low", "low": "tall", "narrow": "wide", "wide": "narrow"}
)
_KINDS = {
    "wooden": "wooden wood holz hölzern en-bois madera legno деревянный деревянная 木 木製",
    "metal": "metal steel iron metallic metall metallen métal acero metallo металлический",
    "glass": "glass gläsern verre cristal vetro стеклянный",
    "plastic": "plastic kunststoff plastique plástico plastica",
    "leather": "leather leder cuir cuero pelle кожаный",
    "round": "round circular rund runde runder rundes rond ronde redondo redonda rotondo rotonda круглый круглая 圆 丸い",
    "square": "square rectangular eckig quadratisch carré carrée cuadrado quadrato",
    "standing": "standing floor-standing freestanding upright",
    "wall-mounted": "wall-mounted mounted hanging wall",
    "double": "double doppel",
    "single": "single einzel",
    "framed": "framed gerahmt gerahmte encadré encadrée",
    "old": "old alt alte",
    "new": "new neu neue",
    "empty": "empty leer leere",
    "open": "open offen offene",
}


def _shaded(text: str) -> list[str]:
    """Some languages write a shade and its colour as one word: dunkelgrün, 深蓝色."""
    shades = {True: ("hell", "dunkel"), False: ("深", "浅", "淡", "暗")}
    return [shade + word for word in fold(text).split() for shade in shades[word.isascii()]]


def _attribute_table() -> Mapping[str, tuple[str, str]]:
    groups = (("colour", _COLOURS), ("size", _SIZES), ("kind", _KINDS))
    return MappingProxyType(
        {
            word: (group, name)
            for group, table in groups
            for name, text in table.items()
            for word in (*fold(text.replace("-", "")).split(), *(_shaded(text) if group == "colour" else ()))
        }
    )


# Folded word -> (group, canonical English attribute).
ATTRIBUTES = _attribute_table()
