//! What a description in ordinary words says of a drive's look: words and phrases of English, each with what it says of
//! lighting, weather or road surface.
//!
//! The longest phrase that fits is taken. The first word on an axis counts, and a vague one (*dark*, *evening*, *clouds*) only where no
//! other speaks of its axis. What is denied (*no rain*) says nothing. Words that neither say something here nor only hold a
//! sentence together are named, so that nobody waits for what will not come.

use crate::condition::{Condition, Lighting, RoadSurface, Weather};

/// What a description says.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Wording {
    /// The time of day.
    pub lighting: Option<Lighting>,
    /// What falls from or hangs in the air.
    pub weather: Option<Weather>,
    /// What lies on the road.
    pub surface: Option<RoadSurface>,
    /// Phrases that contradict what was said before them, or what it leaves on the road.
    pub set_aside: Vec<String>,
    /// Words that mean nothing here.
    pub unknown: Vec<String>,
}

/// What a phrase says.
#[derive(Debug, Clone, Copy)]
enum Says {
    Light(Lighting),
    /// A time of day that is meant only where nothing else tells one.
    Vaguely(Lighting),
    Air(Weather),
    /// Clouds, which nobody denies who tells of rain, snow or fog.
    Clouds,
    Ground(RoadSurface),
    /// What has stopped falling: what it leaves, under clouds.
    Left(RoadSurface),
}

use Lighting::{BlueHour, Day, GoldenHour, Night, Sunrise, Sunset, Twilight};
use RoadSurface::{Dry, Puddles, SandCovered, SnowCovered};
use Says::{Air, Clouds, Ground, Left, Light, Vaguely};
use Weather::{Clear, Fog, Rain, Snow};

/// Phrases of as many words as they have, in lower case, `|` between those that say the same.
const PHRASES: &[(&str, Says)] = &[
    (
        "night|nighttime|night time|nights|nocturnal|midnight|after dark|in dark|moonlit|moonlight|starry|stars|moonless|small hours",
        Light(Night),
    ),
    (
        "headlights on|headlamps on|streetlights|street lights|streetlamps|street lamps|lamplight|pitch black|pitch dark",
        Light(Night),
    ),
    ("dark|darkness|headlights|headlamps|moon|unlit", Vaguely(Night)),
    (
        "sunrise|dawn|daybreak|break of day|first light|sun rises|sun rising|rising sun|sun comes up|sun coming up",
        Light(Sunrise),
    ),
    (
        "early morning|early in morning|crack of dawn|sun risen|sun just up|sun up|first rays|rays of dawn",
        Light(Sunrise),
    ),
    ("sunset|sundown|sun sets|sun setting|setting sun|sun goes down|sun going down|evening sun", Light(Sunset)),
    (
        "twilight|dusk|nightfall|gloaming|after sunset|after sundown|getting dark|growing dark|purple sky",
        Light(Twilight),
    ),
    ("evening|evenings", Vaguely(Twilight)),
    (
        "golden hour|golden light|golden sun|golden sunlight|low sun|warm light|warm evening light|late afternoon|amber light",
        Light(GoldenHour),
    ),
    ("golden|amber", Vaguely(GoldenHour)),
    ("blue hour|before sunrise|before dawn|predawn|pre dawn|dim light|blue light|dim blue light", Light(BlueHour)),
    ("day|daytime|daylight|noon|midday|by day|broad daylight|afternoon|high noon|lunchtime", Light(Day)),
    ("morning|mornings", Vaguely(Day)),
    (
        "not cloud in sky|no clouds|no cloud|without clouds|clear|clear sky|clear skies|cloudless|sunny|sunshine|sunlit|blue sky|blue skies|bright sun|fine weather|fair weather",
        Air(Clear),
    ),
    (
        "overcast|cloudy|clouds|cloud cover|clouded|dark clouds|gray|grey|gray sky|grey sky|gray skies|grey skies|dull|gloomy",
        Clouds,
    ),
    (
        "snow|snowing|snows|snowfall|snowy|snowstorm|blizzard|flurry|flurries|snowflakes|flakes|falling snow|snow falling|snow falls",
        Air(Snow),
    ),
    ("sleet|snows heavily|whiteout", Air(Snow)),
    (
        "rain|raining|rains|rainy|rainfall|drizzle|drizzling|drizzly|shower|showers|pouring|downpour|rainstorm|thunderstorm|cloudburst",
        Air(Rain),
    ),
    ("storm|stormy|raindrops|falling rain|rain falling|rain falls|wet weather|monsoon", Air(Rain)),
    ("fog|foggy|mist|misty|haze|hazy|smog|low visibility|poor visibility|murky|fogged", Air(Fog)),
    (
        "snow covered|snow covered road|snow covered street|covered in snow|covered with snow|snow on road|snow on ground",
        Ground(SnowCovered),
    ),
    (
        "snow on street|snowy road|snowy roads|snowy street|snowy streets|snowy ground|snowy landscape|snow lies|lying snow",
        Ground(SnowCovered),
    ),
    (
        "snow lying|snow packed|packed snow|white road|white with snow|snowed in|blanket of snow|snowbound|wintry|winter|icy",
        Ground(SnowCovered),
    ),
    ("slush|slushy|after snowfall|after snow|after snowstorm|fresh snow|freshly fallen snow|snowed", Left(SnowCovered)),
    (
        "sand|sandy|sand covered|covered in sand|covered with sand|sand on road|sandstorm|dust storm|dunes|desert|dusty",
        Ground(SandCovered),
    ),
    ("blown sand|drifting sand|sand drifts|sand storm|dust|sahara", Ground(SandCovered)),
    (
        "wet|wet road|wet roads|wet street|wet asphalt|puddle|puddles|puddled|standing water|soaked|slick|glistening road",
        Ground(Puddles),
    ),
    ("flooded|waterlogged|wet pavement|damp", Ground(Puddles)),
    ("after rain|after shower|after storm|rained|rain stopped", Left(Puddles)),
    ("dry|dry road|dry roads|dry street|bare road|dry asphalt", Ground(Dry)),
];

/// Words that are passed over wherever they stand.
const PASSED_OVER: &[&str] =
    &["a", "an", "the", "it", "is", "are", "was", "has", "have", "been", "just", "very", "really", "yet"];

/// Words that deny what comes next.
const DENIALS: &[&str] = &["no", "not", "without", "never", "isn", "isnt", "aren", "arent", "neither", "nor", "free"];

/// Words that may stand between a denial and what it denies.
const BETWEEN: &[&str] = &["any", "of", "t", "much", "more", "sign", "trace"];

/// Words that hold a sentence together, and those of what layouts tell: they are no look, and nobody is surprised.
const QUIET: &str = "and any around as at away back be behind beneath beside big bit but by can cast casts city come comes country \
    countryside deep dense down drive driver drives driving during early end ego empty everywhere fall falling falls few \
    from front full get gets giving glow glowing going gone heavily heavy high highway hour i in into its large late \
    leaves lies light lighting lightly like lit little long lot lots low many me middle more most much my near of off on \
    onto other our out over overhead pale past patch patches photo picture please quiet rather road roads rural s scene \
    scenery season shine shines show shows side sky skies slow slowly small so soft some still street streets strong sun \
    sunlight t than that their them then there these they thick thin this those through time to town two under up urban \
    video view visible way we weather were what when where which while wide will with you your air bright brightly broad \
    evenly sets rises set hangs hanging lying covered drifting gentle intersection crossroads roundabout crossing junction \
    curve curves bend straight left right turn turning leftward rightward lane lanes single double multiple motorway \
    signal traffic red yellow green unknown crosswalk zebra car cars vehicle vehicles truck trucks van bus lone parked \
    waiting or oncoming leader close distant slowing pedestrian pedestrians people person walking waits cyclist cyclists \
    riding stopped bicycle bicycles cones barriers stands brakes accelerates creeps cruises hurries house houses building \
    buildings tree trees streaks suburb suburban residential avenue camera dashcam windshield image frame all whole being \
    do does shadow shadows horizon alley commute trip breaks spring summer autumn first am pm o clock coming";

impl Wording {
    /// Reads a description.
    #[must_use]
    pub fn read(text: &str) -> Self {
        let text = text.to_lowercase();
        let words = text.split(|c: char| !c.is_alphanumeric());
        let words: Vec<&str> = words.filter(|word| !word.is_empty() && !PASSED_OVER.contains(word)).collect();
        let (mut told, mut vague, mut denied, mut at) = (Self::default(), Self::default(), false, 0);
        while let Some(word) = words.get(at) {
            let Some((says, length)) = longest(&words[at..]) else {
                if DENIALS.contains(word) {
                    denied = true;
                } else if !(denied && BETWEEN.contains(word)) {
                    denied = false;
                    if !QUIET.split_whitespace().any(|quiet| quiet == *word) && word.parse::<f64>().is_err() {
                        told.unknown.push((*word).to_owned());
                    }
                }
                at += 1;
                continue;
            };
            if !std::mem::take(&mut denied) {
                let phrase = words[at..at + length].join(" ");
                let outspoken = match says {
                    Vaguely(_) | Clouds => {
                        vague.say(says);
                        true
                    }
                    Left(surface) => {
                        vague.say(Clouds);
                        told.say(Ground(surface))
                    }
                    Light(_) | Air(_) | Ground(_) => told.say(says),
                };
                if !outspoken {
                    told.set_aside.push(phrase);
                }
            }
            at += length;
        }
        told.lighting = told.lighting.or(vague.lighting);
        told.weather = told.weather.or(vague.weather);
        if let Some((weather, surface)) = told.weather.zip(told.surface)
            && Condition::new(Lighting::Day, weather, surface).is_err()
        {
            told.set_aside.push(surface.words().to_owned());
            told.surface = None;
        }
        told
    }

    /// Takes what a phrase says; false if another has said something else of that axis.
    fn say(&mut self, says: Says) -> bool {
        fn once<T: Copy + PartialEq>(axis: &mut Option<T>, value: T) -> bool {
            *axis.get_or_insert(value) == value
        }
        match says {
            Light(lighting) | Vaguely(lighting) => once(&mut self.lighting, lighting),
            Air(weather) => once(&mut self.weather, weather),
            Clouds => once(&mut self.weather, Weather::Overcast),
            Ground(surface) | Left(surface) => once(&mut self.surface, surface),
        }
    }

    /// Says what of the description is not followed, a line each.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let list = |words: &[String]| words.iter().map(|word| format!("{word:?}")).collect::<Vec<_>>().join(", ");
        let mut remarks = Vec::new();
        if self.condition().is_none() {
            remarks.push("nothing in it tells of lighting, weather or what lies on the road".to_owned());
        }
        if !self.set_aside.is_empty() {
            remarks.push(format!("set aside, for it contradicts the rest: {}", list(&self.set_aside)));
        }
        if !self.unknown.is_empty() {
            remarks.push(format!("means nothing to the model: {}", list(&self.unknown)));
        }
        remarks
    }

    /// Returns the look; what is not said is as [`Condition`] has it where it is not said in a name. None if nothing is said.
    #[must_use]
    pub fn condition(&self) -> Option<Condition> {
        if self.lighting.is_none() && self.weather.is_none() && self.surface.is_none() {
            return None;
        }
        Some(Condition::of(self.lighting, self.weather, self.surface).expect("what excludes each other is set aside"))
    }
}

/// Returns what the longest phrase at the start of some words says, and its number of words.
fn longest(words: &[&str]) -> Option<(Says, usize)> {
    let fits = |phrase: &str| {
        let mut count = 0;
        let same = phrase.split(' ').all(|word| {
            count += 1;
            words.get(count - 1) == Some(&word)
        });
        same.then_some(count)
    };
    let found = |(phrases, says): &(&str, Says)| phrases.split('|').filter_map(fits).max().map(|count| (*says, count));
    PHRASES.iter().filter_map(found).max_by_key(|(_, count)| *count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinary_words_name_the_conditions_of_the_benchmark() {
        let wordings: &[(&str, &[&str])] = &[
            ("sunrise", &["at dawn", "the sun is just coming up", "early morning, first light"]),
            ("sunset", &["driving into the setting sun", "the sun goes down", "a street at sundown"]),
            ("twilight", &["dusk", "an evening in town", "it is getting dark"]),
            ("golden-hour", &["late afternoon, long shadows", "warm light of the golden hour", "golden evening"]),
            ("blue-hour", &["just before sunrise", "pre-dawn", "the blue hour"]),
            ("night", &["a dark street with headlights on", "it is midnight", "after dark, street lamps"]),
            ("overcast", &["a cloudy day", "grey skies", "gloomy weather, dark clouds"]),
            ("snow", &["it is snowing heavily", "a snowy day", "blizzard"]),
            ("rain", &["pouring rain", "a rainy afternoon", "thunderstorm with a downpour"]),
            ("fog", &["thick mist over the road", "a hazy morning", "poor visibility"]),
            ("snow_covered", &["fresh snow lies on the ground", "a snowy road under clouds", "after the snowfall"]),
            ("sand_covered", &["a desert road", "sand blown over the street", "dusty and sunny"]),
            ("puddles", &["wet asphalt after rain", "standing water on a cloudy day", "the rain has stopped"]),
        ];
        for (name, texts) in wordings {
            for text in *texts {
                let wording = Wording::read(text);
                let found = wording.condition().map(|condition| condition.to_string());
                let wanted = name.parse::<Condition>().expect("a condition").to_string();
                assert_eq!(found, Some(wanted), "{text:?}: {wording:?}");
            }
        }
    }

    #[test]
    fn names_and_words_of_conditions_are_read_as_they_are_meant() {
        for condition in Condition::all() {
            let wording = Wording::read(&condition.words());
            assert_eq!(wording.condition(), Some(condition), "{:?}: {wording:?}", condition.words());
            assert!(wording.unknown.is_empty() && wording.set_aside.is_empty(), "{wording:?}");
        }
    }

    #[test]
    fn what_is_denied_contradicted_or_unheard_of_is_no_look() {
        let denied = Wording::read("a night without any rain, not snowing, no fog");
        assert_eq!(denied, Wording { lighting: Some(Night), ..Wording::default() });
        let both = Wording::read("a sunny day with heavy rain");
        assert_eq!((both.weather, both.set_aside), (Some(Clear), vec!["rain".to_owned()]));
        let drizzle = Wording::read("overcast with a light drizzle");
        assert_eq!((drizzle.weather, drizzle.set_aside.len()), (Some(Rain), 0));
        let slush = Wording::read("snowing on a wet road");
        assert_eq!((slush.condition(), slush.set_aside.len()), ("snow".parse().ok(), 1));
        let strange = Wording::read("a purple dragon at 7.5 m, few cars");
        assert_eq!(
            (strange.condition(), strange.unknown),
            (None, vec!["purple".to_owned(), "dragon".to_owned(), "m".to_owned()])
        );
        assert_eq!(Wording::read(""), Wording::default());
    }
}
