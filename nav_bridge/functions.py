"""What things are good for: "where can I cook", "something to sit on", "I am thirsty" -> names of things, best first.

A row matches when all words of one of its word sets are said (each compared by its beginning, so that cook- covers cooking);
the row with the longest match wins. Names are canonical names of the alias table.
"""

from __future__ import annotations

from dataclasses import dataclass

from nav_bridge.words import fold


@dataclass(frozen=True, slots=True)
class Function:
    """A purpose. verbs: alternatives, each a set of word beginnings that must all be said. things: best first; the grade falls along it.

    near: a thing that should be close by ("sit and watch TV": near the television), or "".
    """

    name: str
    verbs: tuple[tuple[str, ...], ...]
    things: tuple[str, ...]
    near: str = ""


def _function(name: str, verbs: str, things: str, near: str = "") -> Function:
    alternatives = tuple(tuple(fold(v).split()) for v in verbs.split("|"))
    return Function(name, alternatives, tuple(t.strip() for t in things.split(",")), near)


# fmt: off
# ruff: noqa: E501  the table is data
FUNCTIONS: tuple[Function, ...] = (
    _function("cook", "cook | fry | prepare food | make food | make dinner | make lunch | make breakfast | prepare meal | boil | kochen | braten | cuisiner | "
              "faire cuire | cocinar | cucinare | готовить | 做饭 | 烹饪 | 料理", "stove, cooktop, oven, microwave"),
    _function("bake", "bake | roast | backen | horne | 焼く", "oven, stove"),
    _function("heat food", "heat food | warm food | heat up | warm up food | reheat | aufwarmen | rechauffer | calentar | разогреть", "microwave, oven, stove"),
    _function("toast", "toast", "toaster"),
    _function("make coffee", "coffee | espresso | kaffee machen", "coffee machine, coffee maker, kettle"),
    _function("boil water", "tea | boil water | hot water | tee machen", "kettle, stove"),
    _function("keep cold", "keep cold | keep cool | keep food | cool drink | cold drink | keep drink | store food | put milk | put the milk | something cold | kuhlen | "
              "refroidir | enfriar | охладить", "refrigerator, freezer"),
    _function("drink", "drink | thirsty | fill bottle | trinken | durst | boire | beber | bere | попить | пить | 喝水", "water dispenser, water cooler, sink, refrigerator"),
    _function("hungry", "hungry | snack | get food | find food | hunger | faim", "refrigerator, kitchen cabinet"),
    _function("eat", "eat | dine | have dinner | have lunch | have breakfast | essen | manger | comer | mangiare | поесть | есть | 吃饭 | 食べ",
              "dining table, table"),
    _function("sit and watch", "sit watch | relax watch | sit tv | watch comfortably | sit see film", "sofa, armchair, chair", near="television"),
    _function("sit", "sit | seat | take a rest | rest my legs | rest | sitzen | hinsetzen | setzen | asseoir | sentar | sedere | sedermi | посидеть | сесть | 坐 | 座",
              "sofa, armchair, chair, stool, bench"),
    _function("relax", "relax | lounge | chill | get comfortable | entspannen", "sofa, armchair, bed"),
    _function("sleep", "sleep | lie down | nap | tired | go to bed | schlafen | hinlegen | dormir | acostar | dormire | спать | поспать | лечь | 睡 | 寝る",
              "bed, sofa"),
    _function("watch", "watch | see film | see a film | fernsehen | regarder | ver la tele | ver peliculas | guardare | смотреть | 看电视 | テレビを見", "television, projector, projection screen"),
    _function("play music", "play music | make music | listen | musik", "piano, stereo, speaker, guitar, radio"),
    _function("play games", "play game | video game", "game console, television"),
    _function("work", "work on | do work | do homework | study | write | desk work | do my work | arbeiten | schreiben | lernen | travailler | ecrire | trabajar | escribir | "
              "lavorare | scrivere | работать | писать | 工作 | 写字 | 仕事", "desk, table"),
    _function("use computer", "computer | check email | browse | surf | type | program", "computer, laptop, monitor, keyboard, desk"),
    _function("print", "print | drucken | imprim | stampare | напечатать | 打印", "printer"),
    _function("copy", "photocopy | scan | copy", "photocopier, printer, scanner"),
    _function("call", "call | phone | telephone | telefonieren | appeler", "telephone"),
    _function("present", "present | draw | write on wall | explain", "whiteboard, blackboard, projection screen"),
    _function("read", "read | find a book | get a book | lesen | lire | leer | leggere | читать", "bookshelf, book, armchair, sofa"),
    _function("store books", "store book | keep book | put book | put books | keep books", "bookshelf, shelf"),
    _function("exercise", "exercise | work out | workout | train | lift weight | lift | get fit | fitness | do sport | gym | trainieren | sport machen | faire du sport | "
              "entrenar | hacer ejercicio | allenar | тренироваться | 锻炼 | 健身 | 運動",
              "dumbbell, weight bench, exercise ball, treadmill, exercise bike, rowing machine, yoga mat, kettlebell, barbell"),
    _function("wash hands", "wash hand | wash my hand | wash my face | clean hand | rinse | brush teeth | brush my teeth | hande waschen | laver les main | lavar manos | "
              "lavarmi le mani | помыть руки | вымыть руки | 洗手 | 手を洗", "sink, bathroom sink, wash basin"),
    _function("wash dishes", "wash dish | wash the dish | clean dish | do the dish | dirty dish | geschirr | vaisselle | platos | piatti | посуду | 洗碗", "dishwasher, kitchen sink, sink"),
    _function("do laundry", "laundry | wash cloth | wash my cloth | wash the cloth | wasche waschen | linge | lavar ropa | bucato | стирать | 洗衣服 | 洗濯", "washing machine"),
    _function("dry clothes", "dry cloth | dry my cloth | dry the cloth", "tumble dryer, drying rack, dryer"),
    _function("iron", "iron cloth | iron shirt | iron my", "ironing board, iron"),
    _function("wash oneself", "shower | bathe | take a bath | wash myself | get clean | duschen | baden | doucher | duchar | помыться | 洗澡 | シャワー", "shower, bathtub"),
    _function("relieve", "pee | poop | use toilet | use the toilet | use bathroom | relieve | use restroom | restroom", "toilet, urinal"),
    _function("throw away", "throw | trash | garbage | rubbish | waste | dispose | discard | litter | wegwerfen | mull | jeter | poubelle | tirar | basura | buttare | "
              "gettare | выбросить | мусор | 扔垃圾 | 扔 | ゴミを捨て | 捨て", "trash can, recycling bin"),
    _function("hang clothes", "hang cloth | hang coat | hang my coat | hang jacket | hang up | put my coat | put my jacket", "coat rack, wardrobe, hook"),
    _function("store clothes", "store cloth | put cloth | keep cloth | put my cloth | get dressed | find cloth | change cloth | kleidung | vetements | ropa guardar",
              "wardrobe, chest of drawers, dresser"),
    _function("store shoes", "shoe | schuhe | chaussures | zapatos | scarpe | обувь | 放鞋 | 靴", "shoe rack, shoe cabinet"),
    _function("look at oneself", "mirror | see myself | look at myself | do makeup | comb", "mirror"),
    _function("tell time", "time is it | tell time | tell the time | check time | check the time | what time | uhrzeit", "clock, wall clock"),
    _function("light", "light | brighten | lamp on | see in the dark | licht", "lamp, floor lamp, table lamp, chandelier, wall lamp"),
    _function("cool the room", "cool the room | cool down | too hot | too warm | lower temperature | klimatisier", "air conditioner, fan"),
    _function("heat the room", "heat the room | warm myself | too cold | i am cold | freezing | get warm", "radiator, heater, fireplace"),
    _function("put out fire", "fire extinguish | put out fire | put out a fire | extinguish", "fire extinguisher"),
    _function("first aid", "first aid | bandage | injur | hurt", "first aid kit, medicine cabinet"),
    _function("clean", "vacuum | clean the floor | sweep | mop", "vacuum cleaner, broom, mop"),
    _function("put flowers", "put flower | arrange flower", "vase"),
    _function("take photos", "surveil | watch over | monitor the room", "security camera"),
    _function("leave", "leave | exit | go outside | get out", "door"),
)
# fmt: on

# What opens a request by purpose, folded; the longest is tried first.
OPENERS: tuple[tuple[str, ...], ...] = tuple(
    sorted(
        (
            tuple(fold(text).split())
            for text in (  # noqa: SIM905  one readable block
                "something to | something for | something i can | something that can | something which can | something where i can | anything to | anything i can | "
                "anything for | a thing to | thing to | things to | somewhere to | somewhere i can | somewhere where i can | a place to | place to | place for | "
                "a place for | a place where i can | place where i can | place where you can | a place i can | a spot to | a spot where i can | where can i | where could i | "
                "where do i | where should i | where can you | where can one | where can we | where may i | where to | where i can | where we can | i want to | "
                "i would like to | i d like to | i need to | i have to | i wanna | i need something to | i want something to | i need a place to | i am | i m | "
                "i feel | what can i use to | what do i use to | what can i | equipment to | equipment for | furniture to | furniture for | a tool to | the thing for | "
                "wo kann ich | wo kann man | etwas zum | etwas um | ich mochte | ich will | ein platz zum | platz zum | ort zum | ich muss | "
                "ou puis je | ou peut on | quelque chose pour | un endroit pour | endroit pour | je veux | je voudrais | "
                "donde puedo | algo para | un lugar para | lugar para | quiero | dove posso | qualcosa per | un posto per | posto per | dove si puo | voglio | "
                "где можно | где я могу | где мне | что нибудь чтобы | место чтобы | место где можно | я хочу | мне надо | хочу"
            ).split("|")
        ),
        key=lambda tokens: (-len(tokens), tokens),
    )
)
# Chinese and Japanese have no blanks: what marks a request by purpose anywhere in the sentence.
MARKERS: tuple[str, ...] = (
    "哪里可以",
    "哪儿可以",
    "在哪里可以",
    "可以",
    "的地方",
    "用来",
    "ところ",
    "場所",
    "できる",
    "ための",
    "たい",
    "想",
)


def find_function(said: tuple[str, ...]) -> Function | None:
    """The purpose that folded words speak of, None when none is known. The most and longest words win, then the table's order."""
    best: tuple[int, int] | None = None
    found: Function | None = None
    for function in FUNCTIONS:
        for verb in function.verbs:
            if all(any(_begins(word, stem) for word in said) for stem in verb):
                score = (len(verb), sum(len(stem) for stem in verb))
                if best is None or score > best:
                    best, found = score, function
    return found


def _begins(word: str, stem: str) -> bool:
    """Whether a word is a stem or an inflection of it; short stems must not swallow other words (tea, team)."""
    if word == stem:
        return True
    if not stem.isascii():
        return word.startswith(stem) or (len(stem) > 0 and ord(stem[0]) > 0x2E80 and stem in word)
    if stem.endswith("e") and word == stem[:-1] + "ing":
        return True
    if not word.startswith(stem):
        return False
    rest = word[len(stem) :]
    return rest in ("s", "es", "ed", "ing", "er", "ning", "ting", "n") or (len(stem) >= 6 and len(rest) <= 4)
