"""Words that carry a goal and are none of it: courtesies, verbs of motion, what splits a sentence in clauses. Data, as ``words``."""

# ruff: noqa: E501, SIM905  the tables are data
from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nav_bridge.words import fold, words

# Of these a sentence may begin with any number in any order: "could you please bring me over to", "ich möchte gern zu".
CARRIERS: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "en": words(
            "i d ll we you can could would will shall should like love want wanna need to please kindly just simply now then maybe go going drive move head walk roll run travel navigate proceed come get getting "
            "bring take send lead guide carry park stop stand wait halt position place put yourself myself itself me us toward towards straight let lets s see check look inspect for at find locate search show reach "
            "approach visit enter know tell where wheres is are your way make try hey hi hello ok okay robot fetch have do mind driving going moving heading walking taking bringing showing finding getting looking"
        ),
        "de": words(
            "bitte kannst könntest kann du sie mich mir uns bring bringe bringst fahr fahre fahren fährst geh gehe gehen gehst lauf laufe komm zu zum zur nach hin ich wir möchte möchten will wollen muss müssen gern gerne "
            "suche such suchen finde finden zeig zeige zeigen wo ist sind steht stehen liegt hängt befindet sich mal doch jetzt sofort roboter hallo nimm hol hole brauche führe begib dich bringen führen kannst"
        ),
        "fr": words(
            "peux tu pouvez vous pourrais pourriez me moi nous mener mène emmène emmener amène amener conduis conduire va vas aller allez dirige toi rends je j veux voudrais aimerais cherche chercher trouve trouver montre montrer "
            "où est sont se s il te plaît jusqu à au aux vers robot bonjour besoin ai d"
        ),
        "es": words(
            "puedes podrías puede podría llévame llevarme llévanos ve ir vaya anda vete quiero quisiera necesito busca buscar encuentra encontrar muéstrame mostrarme dónde está están queda por favor hasta hacia a al robot hola me te acércate dirígete"
        ),
        "it": words(
            "puoi potresti può portami portarmi portaci vai andare andiamo vorrei voglio devo cerca cercare trova trovare trovami mostrami mostrarmi dov dove è sono si per favore fino verso a al alla allo all robot ciao mi ti avvicinati raggiungi"
        ),
        "ru": words(
            "пожалуйста можешь можете мог могли бы ты вы я мы хочу хотел мне нам нужен нужна нужно надо поезжай поехали едь езжай ехать иди идти пойди пойдем подойди подъезжай подъедь отвези отведи проведи провези доставь меня нас найди найти ищи ищу "
            "покажи показать отвезти довезти провести проводить доставить доехать подъехать поехать показать где находится стоит лежит висит к ко до робот привет"
        ),
    }
)
# Carriers only where one of the words after them follows: "over to", "up to", "out on".
PARTICLES = words("up over down across back out off along around close near right in away")
AFTER_PARTICLES = words("to towards toward")
# What is carried somewhere is not the goal, the place is: "deliver the parcel to the printer".
DELIVER = words("bring take carry deliver transport move send")
NO_DESTINATION = words("next close near adjacent closest nearest opposite belongs belonging going")  # before "to"
# They begin a new clause: "in the kitchen there is a toaster", "go into the garage and find the bicycle" (and + a command).
THERE_IS: tuple[tuple[str, ...], ...] = tuple(
    tuple(fold(p).split())
    for p in "there is|there s|there are|is there|steht|gibt es|ist|il y a|hay|c è|ci sono|есть|стоит".split("|")
)
ANDS = words("and und et y e и")
# With a colour these only shade it: dark green, vert clair.
SHADES = words(
    "dark light bright pale deep clair claire foncé foncée claro clara oscura chiara scura claros oscuros oscuro chiaro scuro темно светло ярко"
)
# How many: "between the two armchairs".
NUMBERS = words(
    "two three four both zwei drei vier beiden beide deux trois quatre dos tres cuatro ambos ambas due tre quattro entrambi entrambe два две три четыре двумя тремя обоими обеими"
)
LAST = words(
    "last letzte letzter letztes letzten dernier dernière último última ultimo ultima последний последняя последнее последнюю"
)
OTHER_SIDE: Mapping[str, str] = MappingProxyType(
    {"left": "right", "right": "left"}
)  # the last from there is the first here
# Of several words one meaning that has a word of its own in the tables.
REWRITES: Mapping[str, str] = MappingProxyType(
    {
        fold(said): fold(means)
        for said, means in {
            "n'importe quelle": "quelconque",
            "n'importe quel": "quelconque",
            "no matter which": "any",
            "it doesn't matter which": "any",
            "peu importe lequel": "quelconque",
            "peu importe laquelle": "quelconque",
            "egal welcher": "irgendein",
            "egal welche": "irgendein",
            "egal welches": "irgendein",
            "da igual qué": "cualquier",
            "non importa quale": "qualsiasi",
            "все равно какой": "любой",
        }.items()
    }
)
# Endings of plurals and cases -> of the form that names are listed in, tried in turn where a word is not known.
ENDINGS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "de": (("n", ""), ("en", ""), ("e", ""), ("er", ""), ("ern", ""), ("s", ""), ("es", "")),
        "fr": (("x", ""), ("s", "")),
        "es": (("es", ""), ("s", "")),
        "it": (("e", "a"), ("i", "o"), ("i", "e"), ("hi", "o"), ("he", "a")),
    }
)
