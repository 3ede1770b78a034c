"""The words of the goal grammar, as data: commands, relations, quantifiers, attributes and what things are for, in eight languages.

Names of things and rooms are not here: they come from the alias table. Every phrase is folded (see ``fold``) before it is used,
so accents and case may be written naturally.
"""

# ruff: noqa: E501  the tables are data
from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

LANGUAGES = ("en", "de", "fr", "es", "it", "ru", "zh", "ja")


@lru_cache(16384)
def fold(text: str) -> str:
    """Lower case, Latin and Cyrillic accents dropped, punctuation as single blanks (the alias table's own form)."""
    decomposed = unicodedata.normalize("NFKD", text.casefold())
    kept = "".join(c for c in decomposed if not "\u0300" <= c <= "\u036f")
    return " ".join(
        re.sub(r"[\s\-_'’`´.,;:!?¿¡()\"„“”«»、。！？，]+", " ", unicodedata.normalize("NFKC", kept)).split()
    )


def _phrases(table: Mapping[str, str]) -> Mapping[str, tuple[tuple[str, ...], ...]]:
    """Per language, "a b | c" as token tuples, longest first."""
    split = {lang: {tuple(fold(p).split()) for p in text.split("|")} for lang, text in table.items()}
    return MappingProxyType({lang: tuple(sorted(p, key=lambda t: (-len(t), t))) for lang, p in split.items()})


# What is said before the goal and means no more than "go".
COMMANDS = _phrases(
    {
        "en": "all right | alright | go back | go back to | drive back to | return | return to | come back to | back to | go | go to | go over to | drive | drive to | navigate to | move to | head to | head over to | walk to | come to | travel to | "
        "find | find me | look for | search for | search | locate | show me | show | get to | get | get me to | bring me to | bring me | take me to | "
        "take me | guide me to | lead me to | fetch | where is | where s | where are | where can i find | where do i find | "
        "i want to go to | i want to see | i want | i d like to go to | i would like to go to | i need to go to | i need | i m looking for | "
        "i am looking for | we need | please | robot | hey robot | can you | could you | would you | will you | can you please | could you please | "
        "approach | visit | reach | stop at | park at | park next to | stand at | stand in front of | stand next to | stand by | position yourself at | is there | "
        "are there | do we have | let s go to | now | then | ok | okay | hey | send the robot to | send it to | let the robot go to | enter | go into | drive into | there should be | there must be | there might be | there may be | there has to be",
        "de": "fahr zurück | fahr zurück zu | fahr zurück zum | fahr zurück zur | geh zurück zu | zurück zu | zurück zum | zurück zur | zu | zum | zur | nach | geh | gehe | geh zu | gehe zu | geh zum | gehe zum | geh zur | gehe zur | fahr | fahre | fahr zu | fahr zum | fahr zur | fahre zu | fahre zum | "
        "fahre zur | finde | such | suche | zeig mir | zeige mir | wo ist | wo sind | wo steht | wo hangt | bring mich zu | bring mich zum | bring mich zur | "
        "bringe mich zum | bringe mich zur | ich suche | ich brauche | bitte | navigiere zu | navigiere zum | navigiere zur",
        "fr": "va | va a | va au | va vers | aller a | aller au | allez a | allez au | trouve | trouver | cherche | ou est | ou se trouve | ou sont | "
        "montre moi | emmene moi a | emmene moi au | amene moi a | conduis moi a | je cherche | s il te plait | s il vous plait | va jusqu a | va jusqu au | a | au",
        "es": "ve | ve a | ve al | ir a | ir al | vaya a | vaya al | vamos a | vamos al | encuentra | busca | buscar | donde esta | donde estan | muestrame | "
        "llevame a | llevame al | llevame hasta | necesito | por favor | navega a | navega al | navega hasta | al",
        "it": "vai | vai a | vai al | vai alla | vai allo | vai all | vai verso | andare a | trova | cerca | dov e | dove e | dove si trova | dove sono | "
        "mostrami | portami | portami a | portami al | portami alla | portami allo | portami all | per favore | al | alla",
        "ru": "иди к | иди ко | иди в | иди | поезжай к | поезжай ко | поезжай | езжай к | подойди к | подъезжай к | найди | найти | ищи | где | где находится | "
        "где стоит | покажи | покажи мне | отвези меня | отведи меня | отвези меня к | отведи меня к | мне нужен | мне нужна | мне нужно | пожалуйста | к | ко",
        "zh": "请 | 把机器人开到 | 让机器人去 | 让机器人到 | 开车到 | 去 | 到 | 前往 | 走到 | 开到 | 移动到 | 导航到 | 导航去 | 找 | 找到 | 寻找 | 带我去 | 带我到 | 我要去 | 我想去 | 我要找 | 帮我找 | 给我找",
        "ja": "ロボット | ロボットを | どうか",
    }
)
# What is said after the goal.
TAILS = _phrases(
    {
        "en": "please | now | thanks | thank you | for me | right now | quickly",
        "de": "bitte | bringen | fahren | gehen | führen | kommen",
        "fr": "s il te plait | s il vous plait",
        "es": "por favor",
        "it": "per favore | per piacere",
        "ru": "пожалуйста",
        "zh": "在哪里 | 在哪儿 | 在哪 | 那里 | 那边 | 去 | 旁边去 | 吗 | 吧",
        "ja": "まで行ってください | に行ってください | へ行ってください | まで行って | に行って | へ行って | に行きたいです | に行きたい | へ行きたい | まで行きたい | まで移動して | に移動して | へ移動して | を探してください | を探して | "
        "を見つけて | を見つけてください | はどこですか | はどこにありますか | はどこ | に連れて行って | へ連れて行って | まで連れて行って | に行く | へ行く | まで案内してください | まで案内して | に案内してください | に案内して | まで来て | に来て | まで進んで | の所へ行って | のところへ行って | まで | へ",
    }
)
# Words that tell a Latin-script language from another.
_MARKS = {
    "en": "i am me the a an to of with is my where next near at on under above beside between something somewhere please find go nearest any in for",
    "de": "links rechts der die das den dem des ein eine einen einer neben im am auf unter über vor hinter zwischen bei mit zum zur wo ist beim "
    "etwas nicht und kann ich der nähe von",
    "fr": "dehors hors gauche droite depuis vu vue plus le la les un une des du de dans sur sous près côté où est au aux devant derrière entre avec à quelque chose pour l d",
    "es": "a izquierda derecha desde visto vista más hasta el la los las un una unos unas del de en sobre bajo debajo junto cerca lado dónde está delante detrás entre con al algo para encima",
    "it": "sinistra destra dalla dal visto vista più nell sull dell all dall nei il lo la gli le un una uno del della dello dei nel nella nello sul sulla sotto sopra accanto vicino davanti dietro tra fra con "
    "in di da al alla qualcosa per dove l",
}
MARKS: Mapping[str, frozenset[str]] = MappingProxyType(
    {lang: frozenset(fold(text).split()) for lang, text in _MARKS.items()}
)

# Relations: how the goal (or its room) is placed against something else.
_RELATIONS: Mapping[str, Mapping[str, str]] = {
    "near": {
        "en": "next to | near | near to | nearby | beside | by | close to | adjacent to | alongside | around | to the side of | at the side of | "
        "attached to | touching",
        "de": "neben | nahe | bei | beim | in der nähe von | in der nähe vom | in der nähe des | in der nähe der | direkt neben",
        "fr": "à côté de | à côté du | à côté des | près de | près du | près des | à côté d | près d | proche de | proche du",
        "es": "al lado de | al lado del | junto a | junto al | cerca de | cerca del | al costado de",
        "it": "accanto a | accanto al | accanto alla | accanto allo | accanto all | vicino a | vicino al | vicino alla | vicino allo | vicino all | "
        "di fianco a | di fianco al | di fianco alla | presso | a fianco del | a fianco della",
        "ru": "рядом с | рядом со | возле | около | у | близко к | недалеко от | около",
    },
    "left": {
        "en": "left of | to the left of | on the left of | on the left side of | at the left of | on the left hand side of | on the left hand of",
        "de": "links von | links vom | links neben | links der | links des | auf der linken seite von | auf der linken seite vom",
        "fr": "à gauche de | à gauche du | à gauche des | à gauche d | sur la gauche de | sur la gauche du",
        "es": "a la izquierda de | a la izquierda del | a mano izquierda de | a mano izquierda del",
        "it": "a sinistra di | a sinistra del | a sinistra della | a sinistra dello | a sinistra dell | alla sinistra di | alla sinistra del | alla sinistra della",
        "ru": "слева от | левее | по левую сторону от",
    },
    "right": {
        "en": "right of | to the right of | on the right of | on the right side of | at the right of | on the right hand side of | on the right hand of",
        "de": "rechts von | rechts vom | rechts neben | rechts der | rechts des | auf der rechten seite von | auf der rechten seite vom",
        "fr": "à droite de | à droite du | à droite des | à droite d | sur la droite de | sur la droite du",
        "es": "a la derecha de | a la derecha del | a mano derecha de | a mano derecha del",
        "it": "a destra di | a destra del | a destra della | a destra dello | a destra dell | alla destra di | alla destra del | alla destra della",
        "ru": "справа от | правее | по правую сторону от",
    },
    "at": {"en": "at | belonging to | for | of | from", "de": "am | an | an der | an dem | zu | zum | vom | von", "ru": "за"},
    "of": {"fr": "à partir de | de | du | de la | de l | des | d", "es": "desde | de | del | de la | de los", "it": "di | del | della | dello | dell | dei | da"},
    "on": {
        "en": "on | on top of | atop | upon | lying on | sitting on | standing on | onto",
        "de": "auf | oben auf",
        "fr": "sur | au dessus sur",
        "es": "sobre",
        "it": "su | sul | sulla | sullo | sull",
        "ru": "на",
    },
    "over": {"es": "encima de | encima del", "it": "sopra | sopra di | sopra a | sopra al | sopra alla"},
    "under": {
        "en": "under | below | beneath | underneath",
        "de": "unter | unterhalb | unterhalb von | unterm",
        "fr": "sous | au dessous de | au dessous du | en dessous de | en dessous du",
        "es": "bajo | debajo de | debajo del",
        "it": "sotto | sotto a | sotto al | sotto alla",
        "ru": "под",
    },
    "above": {
        "en": "above | over | hanging over | hanging above",
        "de": "über | oberhalb | oberhalb von | überm",
        "fr": "au dessus de | au dessus du | au dessus des",
        "es": "por encima de | por encima del | arriba de | arriba del",
        "it": "al di sopra di | al di sopra del | al di sopra della",
        "ru": "над",
    },
    "front": {
        "en": "in front of | before | facing | opposite | opposite to | opposite of | across from | ahead of",
        "de": "vor | vorm | gegenüber | gegenüber von | gegenüber vom",
        "fr": "devant | en face de | en face du",
        "es": "delante de | delante del | frente a | frente al | enfrente de | enfrente del",
        "it": "davanti a | davanti al | davanti alla | davanti allo | davanti all | di fronte a | di fronte al | di fronte alla",
        "ru": "перед | напротив",
    },
    "behind": {
        "en": "behind | in back of | at the back of",
        "de": "hinter | hinterm",
        "fr": "derrière",
        "es": "detrás de | detrás del",
        "it": "dietro | dietro a | dietro al | dietro alla",
        "ru": "позади",
    },
    "between": {"en": "between | in between", "de": "zwischen", "fr": "entre", "es": "entre", "it": "tra | fra", "ru": "между"},
    "in": {
        "en": "in | inside | inside of | within | into",
        "de": "im | in | in der | in dem | in den | ins | innerhalb",
        "fr": "dans | en | à l intérieur de | à l intérieur du",
        "es": "en | dentro de | dentro del",
        "it": "in | nel | nella | nello | nell | nei | dentro | all interno del | all interno della",
        "ru": "в | во | внутри",
    },
    "with": {"en": "with | where | where there is | that has | which has | having | holding", "de": "mit | wo", "fr": "avec | où", "es": "con | donde", "it": "con | dove", "ru": "с | со | где"},
    "without": {"en": "without", "de": "ohne", "fr": "sans", "es": "sin", "it": "senza", "ru": "без"},
    "nearest": {
        "en": "closest to | nearest to | nearest | closest",
        "de": "am nächsten zu | am nächsten bei | am nächsten an | am nächsten am | am nächsten beim | am nächsten zum | am nächsten zur",
        "fr": "le plus proche de | la plus proche de | le plus proche du | la plus proche du | plus proche de | plus proche du | le plus près de | la plus près du",
        "es": "más cercano a | más cercana a | más cercano al | más cercana al | más cerca de | más cerca del | el más cercano a | la más cercana a | la más cercana al",
        "it": "più vicino a | più vicina a | più vicino al | più vicina al | più vicino alla | più vicina alla | più vicina allo | più vicino allo",
        "ru": "ближе всего к | ближайший к | ближайшая к | ближайшее к | ближайшую к",
    },
    "farthest": {
        "en": "farthest from | furthest from | farthest away from | furthest away from | most distant from",
        "de": "am weitesten von | am weitesten vom | am weitesten weg von | am weitesten weg vom | am weitesten entfernt von | am weitesten entfernt vom",
        "fr": "le plus loin de | la plus loin de | le plus loin du | la plus loin du | le plus éloigné de | la plus éloignée de | le plus éloigné du | la plus éloignée du",
        "es": "más lejos de | más lejos del | más alejado de | más alejada de | más alejado del | más alejada del",
        "it": "più lontano da | più lontana da | più lontano dal | più lontana dal | più lontano dalla | più lontana dalla",
        "ru": "дальше всего от | дальше всех от | самый дальний от | самая дальняя от | самое дальнее от",
    },
    "out": {
        "en": "outside | outside of | out of",
        "de": "außerhalb | außerhalb von | außerhalb der | außerhalb des",
        "fr": "hors de | hors du | en dehors de | en dehors du | à l extérieur de | à l extérieur du",
        "es": "fuera de | fuera del",
        "it": "fuori da | fuori dal | fuori dalla | fuori dall | al di fuori di | al di fuori del | al di fuori della",
        "ru": "вне | снаружи",
    },
}  # fmt: skip


def _relation_table() -> Mapping[str, tuple[tuple[tuple[str, ...], str], ...]]:
    """Per language, (tokens, kind), longest first."""
    out: dict[str, list[tuple[tuple[str, ...], str]]] = {lang: [] for lang in LANGUAGES}
    for kind, by_language in _RELATIONS.items():
        for lang, text in by_language.items():
            out[lang] += [(tuple(fold(p).split()), kind) for p in text.split("|")]
    return MappingProxyType({lang: tuple(sorted(rows, key=lambda r: (-len(r[0]), r))) for lang, rows in out.items()})


RELATIONS = _relation_table()
# Place words behind a thing: 沙发旁边的..., ソファの隣の...
SUFFIX_RELATIONS: tuple[tuple[str, str], ...] = tuple(
    sorted(
        (
            (word, kind)
            for kind, words in {
                "near": "旁边 旁 附近 边上 跟前 际 際 隣 横 そば 近く 脇 となり",
                "left": "左边 左侧 左面 左 左側 左手",
                "right": "右边 右侧 右面 右 右側 右手",
                "between": "之间 中间 间 之間 間",
                "over": "上面 上 うえ",
                "under": "下面 底下 下 した",
                "above": "上方 真上",
                "front": "前面 前 对面 向かい まえ",
                "behind": "后面 后 背后 後ろ うしろ 裏",
                "in": "里面 里 内 中 のなか なか",
            }.items()
            for word in words.split()
        ),
        key=lambda pair: (-len(pair[0]), pair),
    )
)

NEGATIONS = _phrases(
    {
        "en": "not | but not | and not | except | except for | other than | excluding | but not the one | not the one | except the one | not the ones | "
        "that is not | which is not | that s not | that isn t | which isn t | that are not | not one | other than the one | apart from the one | instead of the one",
        "de": "nicht | aber nicht | nicht der | nicht die | nicht das | außer",
        "fr": "pas | pas celui | pas celle | mais pas | mais pas celui | mais pas celle | sauf",
        "es": "no | pero no | no el | no la | pero no el | pero no la | excepto",
        "it": "non | ma non | non quello | non quella | ma non quello | ma non quella | tranne",
        "ru": "не | но не | не тот | не та | но не тот | кроме",
    }
)


def _viewpoints(table: Mapping[str, Mapping[str, str]]) -> Mapping[str, tuple[tuple[tuple[str, ...], str], ...]]:
    """Per language, (tokens, eye), longest first."""
    rows = {
        lang: [(tuple(fold(p).split()), eye) for eye, text in eyes.items() for p in text.split("|")]
        for lang, eyes in table.items()
    }
    return MappingProxyType(
        {lang: tuple(sorted(r, key=lambda x: (-len(x[0]), -len(x[0][0]), x))) for lang, r in rows.items()}
    )


# From where left is left.
VIEWPOINTS = _viewpoints(
    {
        "en": {
            "door": "seen from the door | as seen from the door | viewed from the door | looking from the door | when seen from the door | from the doorway | seen from the doorway | "
            "seen from the entrance | when you enter | when you come in | as you enter | when entering | coming in | coming in from the door | from the door",
            "robot": "seen from me | seen from here | from here | from my side | from your side | seen from you | seen from the robot | as you see it | from where you are | as seen from here",
        },
        "de": {
            "door": "von der tür aus | von der tür aus gesehen | von der tür gesehen | vom eingang aus | vom eingang aus gesehen | wenn man hereinkommt | wenn man reinkommt",
            "robot": "von dir aus | von dir aus gesehen | von hier aus | von hier aus gesehen | von mir aus gesehen",
        },
        "fr": {
            "door": "vu de la porte | vue de la porte | vu depuis la porte | vue depuis la porte | depuis la porte | en entrant",
            "robot": "vu d ici | vue d ici | depuis ici | de ton point de vue",
        },
        "es": {
            "door": "visto desde la puerta | vista desde la puerta | desde la puerta | al entrar | entrando",
            "robot": "visto desde aquí | vista desde aquí | desde aquí",
        },
        "it": {
            "door": "visto dalla porta | vista dalla porta | dalla porta | guardando dalla porta | entrando",
            "robot": "visto da qui | vista da qui | da qui",
        },
        "ru": {
            "door": "если смотреть от двери | если смотреть с порога | от двери | от входа | если войти | при входе",
            "robot": "отсюда | если смотреть отсюда | от тебя",
        },
        "zh": {"door": "从门口看 | 从门看 | 从门口看去 | 从门口看过去 | 进门", "robot": "从这里看 | 从这儿看"},
        "ja": {
            "door": "ドアから見て | 入口から見て | 入り口から見て | 扉から見て",
            "robot": "ここから見て | そこから見て",
        },
    }
)


def words(text: str) -> frozenset[str]:
    """Blank-separated words, folded, as a set."""
    return frozenset(fold(text).split())


ARTICLES = words(
    "the a an this that these those my your our his her their its der die das den dem des ein eine einen einem einer eines mein meine "
    "le la les l un une des mon ma mes du el los las unos unas mi il lo gli i uno una del della al alla той этот эта это"
)
INDEFINITE = words(
    "a an any some one einer anything something one either ein eine einen irgendein irgendeine un une uno una quelque algún alguna qualche какой-нибудь любой любая любое 任意 一个 どれか"
)
ANY = words(
    "any some whichever irgendein irgendeine irgendeinen quelconque algún alguna cualquier cualquiera qualsiasi qualunque beliebig beliebige beliebiger beliebiges qualche любой любая любое любую"
)
NEAREST = words(
    "nearest closest nächste nächsten nächster nächstes nächstgelegene nächstgelegenen más-cercano cercano cercana ближайший ближайшая ближайшее ближайшую ближайшему proche vicino vicina"
)
FARTHEST = words(
    "farthest furthest weiteste weitesten entfernteste entferntesten éloigné éloignée lejano lejana lontano lontana дальний дальняя дальнее дальнего"
)
LARGEST = words("largest biggest größte größten größter größtes самый-большой 最大")
SMALLEST = words("smallest littlest tiniest kleinste kleinsten kleinster kleinstes 最小")
TALLEST = words("tallest highest")
LOWEST = words("lowest shortest")
# Before an adjective these make a superlative: la plus grande, el más grande, самый большой.
MOST = words("plus más più самый самая самое самую самого самой most am")
SUPERLATIVES: Mapping[str, str] = MappingProxyType(
    {"large": "largest", "small": "smallest", "tall": "tallest", "low": "lowest"}
)
LEFT = words(
    "left leftmost lefthand links linke linker linkes linken gauche izquierda izquierdo sinistra sinistro слева левый левая левое левую левого"
)
RIGHT = words(
    "right rightmost righthand rechts rechte rechter rechtes rechten droite derecha derecho destra destro справа правый правая правое правую правого"
)
# What may stand with left and right: on the left hand side, de la izquierda, à gauche.
SIDE = words("side hand end seite côté lado mano lato стороне сторона a al alla à de di du")
ORDINALS: Mapping[str, int] = MappingProxyType(
    {
        word: n
        for n, row in enumerate(
            (
                "first 1st erste ersten erster erstes premier première primero primera primo prima первый первая первое первую первому",
                "second 2nd zweite zweiten zweiter zweites deuxième seconde segundo segunda secondo seconda второй вторая второе вторую второму",
                "third 3rd dritte dritten dritter drittes troisième tercero tercera terzo terza третий третья третье третью третьему",
                "fourth 4th vierte vierten vierter viertes quatrième cuarto cuarta quarto quarta четвертый четвертая четвертое четвертую",
                "fifth 5th fünfte fünften fünfter fünftes cinquième quinto quinta пятый пятая пятое пятую",
            ),
            1,
        )
        for word in fold(row).split()
    }
)
ME = words("me here us you robot mir hier moi ici mí aquí me-qui мне меня")
PRONOUNS = words("it them top him one ones")
# What was spoken of last, alone or as what a relation refers to.
BACK = words(
    "it there that ihm ihr ihn dort dorthin dahin damit là ça lui y allí allá eso ello lì là esso quello quella это нему нему ней ним туда там него неё него 它 那里 那儿 那边 そこ それ あれ あそこ"
)
# Words between a thing and its relation that say nothing: "the lamp that is standing on ...".
FILLERS = words(
    "entfernt ist sind weg away that which is are was isn aren t n ne stands standing hanging hangs hung located placed lying lies sitting sits mounted kept stored situated there you can see just directly right "
    "immediately somewhere one der die das steht stehen hängt liegt qui est se trouve que está esté esta situado che si trova è который которая которое стоит висит лежит находится"
)
CORNER = words("corner ecke coin esquina rincón angolo углу угол 角落 角 隅")
FLOOR = words("floor ground boden fußboden sol suelo piso pavimento terra полу пол 地板 地上 床")
WALL = words("wall walls wand mur pared muro parete стене стена 墙 墙上 壁")
CEILING = words("ceiling decke plafond techo soffitto потолке потолок 天花板 天井")
HERE = words(
    "room zimmer raum raumes zimmers pièce cuarto stanza комната комнаты комнате 房间 部屋 end ende bout fond final fondo fondo конце"
)  # whichever it is
MIDDLE = words("middle centre center mitte milieu medio centro середине")

# Doors that have a room on one side only.
OUTER_DOORS = frozenset(
    fold(name)
    for name in (  # noqa: SIM905
        "front door|entrance door|entry door|main door|main entrance|house door|outside door|exterior door|back door|Haustür|Eingangstür|Wohnungstür|"
        "porte d'entrée|porte principale|puerta principal|puerta de entrada|porta d'ingresso|porta principale|входная дверь|大门|入口的门|玄関|玄関ドア"
    ).split("|")
)
